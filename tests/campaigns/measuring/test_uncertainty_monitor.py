"""How surely positions are known by accepted shots."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from fake_cell import COVARIANCE_MM2, NOMINAL, TRACKER_FROM_BASE
from goal_plans import OTHERS, PLAN, STATED_STD_MM, mean_std_of, until
from par4_space import par4
from small_plans import OPTIONS

from campaigns.journal.records import Outcome
from campaigns.kinematics.model import Kinematics
from campaigns.measuring.run_state import PositionUncertainty
from campaigns.measuring.work import Work

GOAL_MM = 0.04
"""Met by the 26 identification shots."""
SHOTS = [shot for shot in PLAN if shot.shot not in OTHERS]
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
    return fixing(*fix).uncertainty_monitor.fitted(measured)


def test_what_is_known_is_what_identify_states_of_the_same_shots() -> None:
    measured = outcomes()
    for count in (6, len(SHOTS)):
        known = fitted(measured[:count])
        assert known.shots == count
        # derivatives of the nominal robot, whose plate is level: the place of the reflector differs
        assert known.position_std_mm == pytest.approx(mean_std_of(measured[:count]), rel=0.02)
        assert not known.weakest.startswith("reflector")
    assert fitted(measured[:5]) is None


def test_shots_that_scatter_more_than_stated_widen_what_is_known() -> None:
    """Ten times: as stated they would meet the goal."""
    known = fitted(outcomes(std_mm=10.0 * STATED_STD_MM))
    assert fitted(outcomes()).position_std_mm < GOAL_MM < known.position_std_mm
    assert known.scatter_mm == pytest.approx(10.0 * STATED_STD_MM, rel=0.5)


def test_parameters_held_wrongly_do_not_refuse_shots() -> None:
    """The gate frees all sources of error, whatever identify is told to hold.

    With this forearm held at 700 mm it would refuse.
    """
    gate = fixing("arm*.*").gate_after([])
    for outcome in outcomes(truth=LONG_ARMED):
        assert not gate.judge(outcome).refusal
        gate.accept(outcome)
