"""Every scenario, made a cell of every robot of the family."""

import numpy as np
import pytest
from family_cases import MEMBERS

from app.new_campaign import cell_text
from campaigns.robots.robot import find_robot
from sim.cell import Cell
from sim.scenarios.scenario import load_scenario, parse_scenario, scenario_text, shipped_scenarios

all_members = pytest.mark.parametrize("member", MEMBERS, ids=lambda each: each.name)
all_scenarios = pytest.mark.parametrize("name", shipped_scenarios())


def cell_of(member, name):
    return Cell(parse_scenario(cell_text(member.shipped, name), name))


@pytest.mark.parametrize(
    ("member", "name"),
    [
        *((member, "realistic") for member in MEMBERS),
        *((MEMBERS[-1], name) for name in shipped_scenarios() if name != "realistic"),
    ],
    ids=lambda each: getattr(each, "name", each),
)
def test_stands_in_the_middle_of_its_workspace_with_limits_that_it_can_meet(member, name):
    cell = cell_of(member, name)
    assert cell.kind.name == member.name
    assert cell.controller.geometry() == pytest.approx(dict(member.shipped.parameters), abs=1e-9)
    plate = cell.robot.standing.assembly.plate
    assert np.abs(plate.position_mm - member.shipped.workspace_centre[:3]).max() < 60.0
    assert cell.memory()["mechanism"] == member.name
    rotation_mm = cell.scenario.acceptance.rotation_mm
    assert name != "realistic" or (rotation_mm is not None) == (len(member.mechanism.task) > 3)


def test_gears_of_cranks_become_drives_by_the_way_of_a_crank_of_300_mm():
    text = cell_text(find_robot("linear-delta").robot, "gears").replace(
        "ripple_mm", "ratio_ppm: 50.0\n    ripple_mm"
    )
    told = parse_scenario(text, "cell").robot.transmission
    assert told.ripple_mm == pytest.approx(300.0 * np.radians(10.0 / 3600.0), abs=1e-5)
    assert told.pitch_mm == pytest.approx(2.0 * np.pi * 300.0 / 30.0, abs=1e-5)
    assert (told.eccentricity_um, told.ratio_ppm) == (0.0, 50.0)


def test_motors_of_unlike_rates_have_their_mean_at_other_arms(tmp_path):
    cell, turns = tmp_path / "cell.yaml", "ripples_per_turn: [30.0, 30.0, 50.0, 50.0]"
    gears = scenario_text("gears").replace("ripples_per_turn: 30.0", turns)
    cell.write_text(gears, encoding="utf-8")
    text = cell_text(find_robot("delta").robot, str(cell))
    assert parse_scenario(text, "cell").robot.transmission.ripples_per_turn == 40.0


@all_members
def test_its_errors_are_as_large_as_the_scenario_s(member):
    """Of the robot's own parameters, drawn by the seed; the frame's are nominal."""
    nominal = dict(member.shipped.parameters)
    text = cell_text(member.shipped, "paper-simulation")
    scenario = parse_scenario(text, "cell")
    errors = []
    for seed in range(20):
        true = Cell(scenario, seed=seed).true_geometry
        errors += [true[name] - nominal[name] for name in nominal if name.endswith("forearm_mm")]
        assert true["arm0.x_mm"] == nominal["arm0.x_mm"]
    told = load_scenario("paper-simulation").robot.errors.items()
    sizes = [error for name, error in told if name.endswith(("arm_mm", "plate_mm"))]
    assert np.std(errors) == pytest.approx(np.sqrt(np.mean(np.square(sizes))), rel=0.3)


@all_scenarios
def test_of_the_same_robot_is_the_scenario_as_it_was_written(name):
    assert cell_text(find_robot("par4-prototype").robot, name) == scenario_text(name)
