"""What accepted shots tell of the parameters."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from fake_cell import COVARIANCE_MM2, NOMINAL, TRACKER_FROM_BASE
from goal_plans import OTHERS, PLAN, STATED_STD_MM, until, worst_length_of
from par4_space import SPACE, par4
from small_plans import SETUP

from campaigns.journal.records import Outcome
from campaigns.measuring.run_state import ParameterUncertainty
from campaigns.measuring.work import Work
from campaigns.mechanisms.mechanism import Kinematics

GOAL_MM = 0.2
"""Met by about 20 of the 26 identification shots."""
SHOTS = [shot for shot in PLAN if shot.shot not in OTHERS]
MORE = (*SPACE.free_by_default, "arm1.azimuth_deg", "arm2.axis_tilt_deg")
FEWER = tuple(name for name in SPACE.free_by_default if not name.endswith("forearm_mm"))


def outcomes(std_mm: float = STATED_STD_MM, truth: Kinematics = NOMINAL) -> list[Outcome]:
    """The plan's shots to identify from, stated to scatter by 0.01 mm, whatever they do."""
    joints = np.array([shot.joints for shot in SHOTS])
    exact_mm = TRACKER_FROM_BASE.apply(truth.forward(joints).values_or_raise()[:, :3])
    points_mm = exact_mm + std_mm * np.random.default_rng(1).standard_normal(exact_mm.shape)
    return [
        Outcome(shot.shot, 1, shot.joints, tuple(point), COVARIANCE_MM2, None, "", "", None)
        for shot, point in zip(SHOTS, points_mm.tolist(), strict=True)
    ]


def freeing(free: tuple[str, ...]) -> Work:
    """No goal, and these parameters to be identified."""
    return until(None, setup=replace(SETUP, free=free))


def fitted(measured: Sequence[Outcome], free=SPACE.free_by_default) -> ParameterUncertainty | None:
    return freeing(free).uncertainty_monitor().fitted(measured)


def test_shots_that_scatter_more_than_stated_widen_what_they_tell() -> None:
    """Three times: as stated they would meet the goal."""
    known = fitted(outcomes(std_mm=3.0 * STATED_STD_MM))
    assert known.length_std_mm > GOAL_MM > known.length_std_mm / known.scatter
    assert known.is_widened
    assert known.scatter == pytest.approx(3.0, rel=0.3)


def test_one_wrong_shot_does_not_keep_a_goal_from_being_met() -> None:
    measured = outcomes()
    x, y, z = measured[6].point_in_tracker_mm
    measured[6] = replace(measured[6], point_in_tracker_mm=(x, y + 1.5, z))
    assert fitted(measured).length_std_mm < GOAL_MM < worst_length_of(measured)


def test_few_shots_or_a_covariance_that_cannot_be_tell_nothing() -> None:
    measured = outcomes()
    before, after = fitted(measured[:20]), fitted(measured[:21])
    assert (before.shots, after.shots) == (20, 21)
    assert after.length_std_mm < before.length_std_mm
    assert fitted([]) is fitted(measured[:8]) is None
    broken = [replace(each, covariance_mm2=((-1.0, 0.0, 0.0),) * 3) for each in measured]
    assert fitted(broken) is None


def test_what_is_held_at_nominal_scatters_what_is_told() -> None:
    off = par4(NOMINAL.parameters | {"arm1.forearm_mm": 700.8, "arm3.forearm_mm": 698.8})
    assert fitted(outcomes(truth=off), FEWER).scatter > 2.0


def test_what_is_known_is_of_the_parameters_that_identify_will_look_for() -> None:
    measured = outcomes()
    more, usual, fewer = (fitted(measured, free) for free in (MORE, SPACE.free_by_default, FEWER))
    assert more.shots == len(SHOTS)
    assert more.length_std_mm > 1.02 * usual.length_std_mm
    assert fewer.length_std_mm < 0.98 * usual.length_std_mm


def test_parameters_held_wrongly_do_not_refuse_shots() -> None:
    """The gate looks for the usual parameters, whatever identify is told to hold.

    With this forearm held at 700 mm it would refuse, 3 mm off.
    """
    long_armed = par4(NOMINAL.parameters | {"arm1.forearm_mm": 720.0})
    gate = freeing(FEWER).gate_taught_by([])
    for outcome in outcomes(truth=long_armed):
        assert not gate.judge(outcome.joints, outcome.point_in_tracker_mm).refusal
        gate.accept(outcome)
