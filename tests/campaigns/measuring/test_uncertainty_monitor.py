"""How surely positions are known by accepted shots, and what the gate predicts by them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from fake_cell import COVARIANCE_MM2, NOMINAL, TRACKER_FROM_BASE
from goal_plans import OTHERS, PLAN, STATED_STD_MM, mean_std_of, until
from par4_space import par4
from small_plans import OPTIONS

from campaigns.fit.error_model import ErrorModel
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.journal.records import Outcome
from campaigns.kinematics.mechanism import Kinematics
from campaigns.measuring.run_state import PositionUncertainty
from campaigns.measuring.running_fit import RunningFit
from campaigns.measuring.work import Work

GOAL_MM = 0.04
"""Met by the 26 identification shots."""
SHOTS = [shot for shot in PLAN if shot.shot not in OTHERS]
OFFSETS = ("arm*.joint_offset_deg", "arm*.forearm_mm")
LONG_ARMED = par4(NOMINAL.parameters | {"arm1.forearm_mm": 710.0})


def outcomes(std_mm: float = STATED_STD_MM, truth: Kinematics = NOMINAL) -> list[Outcome]:
    """The plan's shots to identify from, stated to scatter by 0.01 mm, whatever they do."""
    joints = np.array([shot.joints for shot in SHOTS])
    exact_mm = TRACKER_FROM_BASE.apply(truth.forward(joints).values_or_raise()[:, :3])
    points_mm = exact_mm + std_mm * np.random.default_rng(1).standard_normal(exact_mm.shape)
    return [
        Outcome(shot.shot, 1, shot.joints, tuple(point), COVARIANCE_MM2, None, "", "", None)
        for shot, point in zip(SHOTS, points_mm.tolist(), strict=True)
    ]


def fixing(*names: str) -> Work:
    """No goal, and these parameters held."""
    return until(None, options=replace(OPTIONS, fix=names))


def fitted(measured: Sequence[Outcome], *fix: str) -> PositionUncertainty | None:
    return fixing(*fix).uncertainty_monitor().fitted(measured)


def test_what_is_known_is_what_identify_states_of_the_same_shots() -> None:
    measured = outcomes()
    for count in (6, 12, len(SHOTS)):
        known = fitted(measured[:count])
        assert known.shots == count
        assert known.position_std_mm == pytest.approx(mean_std_of(measured[:count]), rel=1e-6)
    assert fitted(measured[:5]) is None


def test_shots_that_scatter_more_than_stated_widen_what_is_known() -> None:
    """Ten times: as stated they would meet the goal."""
    known = fitted(outcomes(std_mm=10.0 * STATED_STD_MM))
    assert fitted(outcomes()).position_std_mm < GOAL_MM < known.position_std_mm
    assert known.scatter_mm == pytest.approx(10.0 * STATED_STD_MM, rel=0.5)


def test_one_wrong_shot_does_not_keep_a_goal_from_being_met() -> None:
    measured = outcomes()
    x, y, z = measured[6].point_in_tracker_mm
    measured[6] = replace(measured[6], point_in_tracker_mm=(x, y + 1.5, z))
    known = fitted(measured)
    assert known.shots == len(SHOTS) - 1
    assert known.position_std_mm < GOAL_MM


def test_what_is_held_is_taken_as_known() -> None:
    measured = outcomes()
    assert fitted(measured, *OFFSETS).position_std_mm < fitted(measured).position_std_mm
    assert "forearm" not in fitted(measured, *OFFSETS).weakest


def test_parameters_held_wrongly_do_not_refuse_shots() -> None:
    """The gate frees all sources of error, whatever identify is told to hold.

    With this forearm held at 700 mm it would refuse.
    """
    gate = fixing("arm*.*").gate_taught_by([])
    for outcome in outcomes(truth=LONG_ARMED):
        assert not gate.judge(outcome.joints, outcome.point_in_tracker_mm).refusal
        gate.accept(outcome)


@pytest.fixture
def running() -> RunningFit:
    return RunningFit(ErrorModel(NOMINAL), TrackerUncertainty())


def test_a_running_fit_predicts_ever_better_and_says_how_well(running: RunningFit) -> None:
    measured, errors, stated = outcomes(truth=LONG_ARMED), [], []
    for outcome in measured:
        joints, point = np.array(outcome.joints), np.array(outcome.point_in_tracker_mm)
        predicted = running.predict(joints)
        assert (predicted is None) == (running.shots < 5)
        if predicted is not None:
            errors.append(float(np.linalg.norm(predicted[0] - point)))
            stated.append(predicted[1])
        running.add(joints, point)
    assert np.all(np.array(errors) < 4.0 * np.array(stated))
    assert max(errors[-5:]) < 0.5 < 1.0 < max(errors[:5])
    assert stated[-1] < 0.2 * stated[0]


def test_a_running_fit_that_begins_again_knows_nothing_else(running: RunningFit) -> None:
    measured = outcomes()
    joints = np.array([outcome.joints for outcome in measured])
    points = np.array([outcome.point_in_tracker_mm for outcome in measured])
    for row in range(8):
        running.add(joints[row], points[row] + 50.0 * (row == 3))
    running.restart(joints[8:], points[8:])
    assert running.shots == len(SHOTS) - 8
    point, std_mm = running.predict(joints[0])
    assert np.linalg.norm(point - points[0]) < 4.0 * std_mm
    running.restart(joints[:4], points[:4])
    assert running.predict(joints[5]) is None
    assert running.distance_misfit_mm(joints[5], points[5]) < 0.1
    assert running.distance_misfit_mm(joints[5], points[6]) > 10.0


def test_shots_on_a_line_place_no_frame(running: RunningFit) -> None:
    joints = np.tile(np.array(SHOTS[0].joints), (8, 1))
    for row, own in enumerate(joints):
        running.add(own, np.array([2000.0 + 10.0 * row, 0.0, 0.0]))
    assert running.predict(joints[0]) is None
