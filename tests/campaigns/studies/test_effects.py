"""Affected campaigns and their judgement: what is drawn is true, and a wrong pass is seen."""

from dataclasses import replace

import numpy as np
import pytest
from par4_space import FREE_BY_DEFAULT, IS_ANGLE, indices

from app.study.rods import RodRobots
from campaigns.design.pose_sampling import workspace_poses
from campaigns.errors import OutputExists
from campaigns.estimation.rigid_transforms import Transform, small_rotation
from campaigns.identification.options import IdentificationOptions
from campaigns.planning.plans import PlanRequest, View, make_plan
from campaigns.robots.robot import find_robot
from campaigns.shots.shot_sets import ShotSet
from campaigns.studies.affected import affected_campaign
from campaigns.studies.effect_table import EffectTable, effect_digest
from campaigns.studies.effects import EFFECTS, Effect, effect_of
from campaigns.studies.judged import (
    EffectOutcome,
    EffectSetup,
    EffectTask,
    JudgedCampaign,
    judge,
    position_error_mm,
    run_effects,
)
from campaigns.studies.study import StudySetup, planned_shots
from campaigns.studies.wrong_passes import wrong_passes
from drivers.values import Pose
from sim.scenarios.scenario import load_scenario

pytestmark = pytest.mark.slow

ROBOT = find_robot("par4-prototype").robot
NOMINAL = ROBOT.kinematics
FREE = indices(FREE_BY_DEFAULT)
TURN = small_rotation(np.array([2.1, 0.02, -0.03]))[0]


@pytest.fixture(scope="module")
def setup():
    view = View((2500.0, 0.0, -500.0), (2500.0, 0.0, 75.0), np.radians(25.0))
    request = PlanRequest(80, 10, 2, Pose(0.0, 0.0, -575.0, 0.0))
    shots = make_plan(ROBOT, view, request, np.random.default_rng(1))
    rng, centre = np.random.default_rng(1), ROBOT.workspace_centre
    return EffectSetup(
        StudySetup(
            nominal=NOMINAL,
            shots=planned_shots([shot for shot in shots if shot.purpose is not ShotSet.DRIFT]),
            free=FREE_BY_DEFAULT,
            options=IdentificationOptions(),
            tracker_from_base=Transform(TURN, np.array([2500.0, 400.0, 0.0])),
            seed=3,
        ),
        workspace_poses(NOMINAL, ROBOT.limits, centre, 60, rng),
        RodRobots(load_scenario("realistic").robot),
    )


def truth_of(seed):
    p = NOMINAL.p.copy()
    std = np.where(IS_ANGLE[FREE], np.radians(0.1), 0.5)
    p[FREE] += std * np.random.default_rng(seed).standard_normal(len(FREE))
    return p


def affected(setup, effect, seed=1):
    rng = np.random.default_rng([5, seed])
    return affected_campaign(setup.study, effect, truth_of(seed), rng, setup.beyond_model)


def judged(setup, effect, seed=1):
    return judge(setup, affected(setup, effect, seed))


def one(**told):
    values = {
        "verdict": "pass",
        "model": "standard",
        "doubts": (),
        "known": 22,
        "worst_sigmas": 3.0,
        "square_over_variance": 1.0,
        "covered": 0.95,
        "square_over_least": 1.0,
        "position_mm": 0.01,
        "stated_mm": 0.01,
        "change": "",
        "signal": 0.0,
        "missing": 0,
        "too_many": 0,
        "named": True,
        "false_alarm": False,
    }
    return JudgedCampaign(**{**values, **told})


def test_pass_is_wrong_with_a_parameter_beyond_four_sigmas_and_only_then():
    assert not one(worst_sigmas=3.9).wrong
    assert one(worst_sigmas=4.1).wrong
    assert not one(worst_sigmas=4.1, verdict="not decided").wrong


def test_pass_is_wrong_with_positions_beyond_twice_what_is_stated():
    assert not one(position_mm=0.019).wrong
    assert one(position_mm=0.021).wrong
    assert not one(position_mm=1.0, stated_mm=float("nan")).wrong


def test_wrong_passes_are_counted_once_however_wrong():
    both = one(worst_sigmas=9.0, position_mm=1.0)
    outcomes = [EffectOutcome(n, "none", each) for n, each in enumerate([both, one()])]
    found = wrong_passes([*outcomes, EffectOutcome(2, "none", None, "no robot")])
    assert (found.campaigns, found.failed, found.passed) == (2, 1, 2)
    assert (found.off, found.worse, found.wrong) == (1, 1, 1)
    assert found.errors_over_sigma == pytest.approx(1.0)


def test_true_robot_has_no_position_error(setup):
    made = affected(setup, Effect())
    assert position_error_mm(setup.workspace, made.forward, made.true) < 1e-9
    assert position_error_mm(setup.workspace, made.forward, NOMINAL) > 0.1


def test_clean_points_scatter_about_the_true_robot_as_stated(setup):
    made = affected(setup, Effect())
    frame = setup.study.tracker_from_base
    exact_mm = frame.apply(made.forward(made.shots.joints))
    off = made.shots.points_in_tracker_mm - exact_mm
    size2 = np.linalg.solve(made.shots.stated_covariance_mm2, off[:, :, None])[:, :, 0] * off
    assert 0.8 < size2.sum() / off.size < 1.2


def test_eight_rods_without_faults_are_the_contracted_robot(setup):
    made = affected(setup, Effect(rods_mm=1e-9))
    assert position_error_mm(setup.workspace, made.forward, made.true) < 1e-6


@pytest.mark.parametrize(("size", "sure"), [(0.5, True), (0.005, False)])
def test_signal_tells_a_step_that_can_be_found_from_one_that_cannot(setup, size, sure):
    made = affected(setup, Effect(step="length", size=size), seed=4)
    assert (made.signal() > 7.0) is sure


def test_clean_campaign_has_no_signal(setup):
    assert affected(setup, Effect()).signal() == 0.0


def test_encoder_step_is_named_with_cause_arm_and_place(setup):
    found = judged(setup, Effect(step="joint", size=0.3))
    assert (found.change, found.named, found.passed) == ("right", True, False)


def test_gross_errors_are_counted_when_named(setup):
    found = judged(setup, Effect(gross=3, size=2.0))
    assert (found.missing, found.too_many, found.named) == (0, 0, True)


def test_scale_is_named_and_does_not_pass(setup):
    found = judged(setup, Effect(scale=1.01))
    assert found.named
    assert not found.passed


def test_a_step_that_is_no_step_of_that_arm_is_not_named(setup):
    made = affected(setup, Effect(step="joint", size=0.3))
    found = judge(setup, replace(made, arm=(made.arm + 1) % 4))
    assert (found.change, found.named) == ("cause", False)


def test_change_in_a_clean_campaign_is_a_false_alarm(setup):
    made = affected(setup, Effect(step="joint", size=0.3))
    assert not judge(setup, made).false_alarm
    assert judge(setup, replace(made, effect=Effect())).false_alarm


def test_sizes_of_an_effect_are_taken_in_turn():
    kinds = EFFECTS["bumped-stand"]
    assert [effect_of("bumped-stand", number) for number in range(4)] == [*kinds, kinds[0]]


def test_numbers_do_not_depend_on_how_campaigns_are_divided(setup):
    truths = np.array([truth_of(seed) for seed in (0, 1)])
    both = run_effects(EffectTask(setup, "gross-errors", (0, 1), truths))
    (second,) = run_effects(EffectTask(setup, "gross-errors", (1,), truths[1:]))
    assert both[1] == second


def test_table_keeps_every_outcome(setup, tmp_path):
    table = EffectTable(tmp_path / "effect.csv", effect_digest(setup, "clean", "drawn"))
    told = one(doubts=("hold-out", "lack-of-fit"), stated_mm=float("nan"), change="place")
    outcomes = {
        0: EffectOutcome(0, "none", told),
        1: EffectOutcome(1, "none", None, "no robot, at all"),
    }
    table.write(outcomes)
    back = table.read()
    assert back[1] == outcomes[1]
    assert repr(back[0]) == repr(outcomes[0])
    other = replace(table, study=effect_digest(setup, "drift", "drawn"))
    with pytest.raises(OutputExists, match="another study"):
        other.read()
