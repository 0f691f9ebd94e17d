"""What is run: scenarios, what is changed in them, and one real seed of a small campaign."""

import math

import pytest
from command_line import SMALL_TESTS, change
from made_up import TABLE_I

from app.console import Terminal
from app.exits import AppError
from app.new_campaign import create_simulated
from app.papers.corbel2006.trials import (
    EXPERIMENTS,
    PROTOTYPE,
    REPEATABILITY,
    ROBOT,
    SIMULATION,
    Trial,
    adapt,
    result_of,
    trials,
)
from app.rehearsal import rehearse
from campaigns.campaign import open_campaign
from campaigns.identification.options import AS_THE_PAPER
from sim.scenarios.scenario import load_scenario

SMALL = {"plan.shots": 48, "plan.validation_pairs": 4, **SMALL_TESTS}


def made(folder, trial):
    create_simulated(folder, ROBOT, trial.experiment.scenario, trial.seed)
    adapt(folder, trial)
    return open_campaign(folder)


def test_seeds_take_turns_so_that_a_broken_off_run_is_even():
    assert [str(trial) for trial in trials(2)] == [
        "simulation, seed 1",
        "repeatability, seed 1",
        "prototype, seed 1",
        "simulation, seed 2",
        "repeatability, seed 2",
        "prototype, seed 2",
    ]


def test_seed_draws_noise_and_pairs(tmp_path):
    campaign = made(tmp_path / "one", Trial(SIMULATION, 17))
    assert campaign.config.plan.seed == 17
    assert load_scenario(str(tmp_path / "one" / "cell.yaml")).seed == 17


def test_repeatability_is_added_to_the_simulation_and_nothing_else(tmp_path):
    made(tmp_path / "one", Trial(REPEATABILITY, 1))
    cell = load_scenario(str(tmp_path / "one" / "cell.yaml"))
    assert cell.robot.repeatability.position_mm == pytest.approx(0.4 / math.sqrt(3.0))
    shipped = load_scenario("paper-simulation")
    same = {"repeatability": shipped.robot.repeatability}
    assert cell.robot.model_copy(update=same) == shipped.robot
    assert cell.tracker == shipped.tracker


def test_recipes_of_experiments_differ():
    assert len({experiment.recipe() for experiment in EXPERIMENTS}) == len(EXPERIMENTS)


def test_seed_gives_what_was_measured_beside_the_truth(tmp_path):
    trial = Trial(SIMULATION, 3)
    campaign = made(tmp_path / "small", trial)
    change(campaign.path("campaign.yaml"), SMALL)
    change(campaign.path("cell.yaml"), {"speed_up": 1000})
    campaign = open_campaign(campaign.folder)
    document, against = rehearse(campaign, Terminal(as_json=True), AS_THE_PAPER)
    assert document["identification"]["estimator"] == "distances"
    assert document["identification"]["outliers"] == "keep"
    assert against == ()
    assert not campaign.path("report.html").exists(), "nobody reads the page of a seed"
    found = result_of(campaign, trial, 1.5)
    assert (found.experiment, found.seed, found.seconds) == ("simulation", 3, 1.5)
    assert found.recipe == SIMULATION.recipe()
    assert {name: e.true_error for name, e in found.parameters.items()} == pytest.approx(TABLE_I)
    assert max(found.missed("mm")) < 1.0
    assert len(found.fitted.after_mm) == 24
    for name, stage in (("before", found.before), ("after", found.after)):
        told = document[name]
        assert stage.rotation_mm == told["rotation_mm"]
        assert stage.straightness_mm == told["straightness_mm"]
        assert stage.distance_mean_mm == pytest.approx(told["distances_mm"]["mean_abs"])
        assert stage.distance_max_mm == pytest.approx(told["distances_mm"]["max_abs"])
        assert stage.radius_mm == told["repeatability"]["radius_mm"]
    unseen = document["identification"]["unseen_mm"]["after"]["max_abs"]
    assert max(map(abs, found.unseen.after_mm)) == pytest.approx(unseen)


def test_campaign_that_was_broken_off_is_no_result(tmp_path):
    trial = Trial(PROTOTYPE, 1)
    with pytest.raises(AppError, match="prototype, seed 1: series are missing"):
        result_of(made(tmp_path / "one", trial), trial, 1.0)
