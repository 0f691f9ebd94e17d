"""The gate, the drift and the air: what may be data."""

import numpy as np
import pytest
from fake_cell import NOMINAL, TRACKER_FROM_BASE
from small_plans import FOUR_PAIRS, GATE

from campaigns.fit.error_model import ErrorModel
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.journal.records import Outcome
from campaigns.measuring.monitors import DriftMonitor, InnovationGate, TemperatureMonitor
from campaigns.measuring.running_fit import RunningFit
from drivers.values import Vector3, Weather

Joints = tuple[float, ...]
JOINTS = [shot.joints for shot in FOUR_PAIRS]


def gate(rules=GATE) -> InnovationGate:
    return InnovationGate(rules, lambda: RunningFit(ErrorModel(NOMINAL), TrackerUncertainty()))


def seen_mm(joints: Joints, off_mm: float = 0.0) -> Vector3:
    pose = NOMINAL.forward(np.array([joints])).values_or_raise()[:, :3]
    point = TRACKER_FROM_BASE.apply(pose)[0] + (0.0, off_mm, 0.0)
    return tuple(point.tolist())


def outcome(shot: int, off_mm: float = 0.0) -> Outcome:
    point = seen_mm(JOINTS[shot], off_mm)
    return Outcome(shot, 1, JOINTS[shot], point, None, None, "", "", None)


def taught(shots: int) -> InnovationGate:
    knowing = gate()
    for shot in range(shots):
        knowing.accept(outcome(shot))
    return knowing


def test_before_the_fit_the_gate_judges_distances() -> None:
    judged = gate().judge(JOINTS[0], (1.0, 2.0, 3.0))
    assert (judged.refusal, judged.residual_mm, judged.predicted_in_tracker_mm) == ("", None, None)
    one = taught(1)
    assert one.judge(JOINTS[1], seen_mm(JOINTS[1], 20.0)).refusal == ""
    refusal = one.judge(JOINTS[1], seen_mm(JOINTS[1], 2000.0)).refusal
    assert "the distance to an earlier shot is" in refusal
    assert "limit 60 mm: a wrong target or a wrong pose" in refusal


def test_known_robot_narrows_the_gate_but_never_widens_it() -> None:
    many = taught(9)
    near = many.judge(JOINTS[9], seen_mm(JOINTS[9], 1.0))
    assert near.refusal == ""
    assert near.residual_mm == pytest.approx(1.0, abs=0.01)
    assert near.predicted_in_tracker_mm == pytest.approx(seen_mm(JOINTS[9]), abs=0.01)
    far = many.judge(JOINTS[9], seen_mm(JOINTS[9], 10.0))
    assert "10.00 mm from the predicted point, limit 3." in far.refusal
    strict = gate(GATE.model_copy(update={"distance_mm": 0.5}))
    for shot in range(9):
        strict.accept(outcome(shot))
    assert "limit 0.50 mm" in strict.judge(JOINTS[9], seen_mm(JOINTS[9], 1.0)).refusal


def test_what_cannot_be_measured_is_refused() -> None:
    assert taught(9).judge(JOINTS[9], (np.nan, 0.0, 0.0)).refusal
    impossible = tuple(np.radians([90.0, -90.0, 90.0, -90.0]).tolist())
    for known in (1, 9):
        assert "cannot be assembled" in taught(known).judge(impossible, (0.0, 0.0, 0.0)).refusal


def test_tracker_is_pointed_where_the_pose_was_or_the_known_frame_has_it() -> None:
    assert taught(3).expected_point_mm(JOINTS[8]) is None
    assert taught(8).expected_point_mm(JOINTS[8]) == pytest.approx(seen_mm(JOINTS[8]), abs=0.01)
    assert np.allclose(JOINTS[0], JOINTS[9]), "both are the drift pose"
    assert taught(1).expected_point_mm(JOINTS[9]) == seen_mm(JOINTS[0])


def test_forgotten_shot_is_as_if_it_had_never_been() -> None:
    spoilt = taught(5)
    spoilt.accept(outcome(5, off_mm=40.0))
    spoilt.reset([5])
    assert spoilt.judge(JOINTS[9], seen_mm(JOINTS[9])) == taught(5).judge(
        JOINTS[9], seen_mm(JOINTS[9])
    )


def test_drift_is_the_distance_from_the_first_shot() -> None:
    watch = DriftMonitor(1.0, None)
    assert watch.moved_mm((1.0, 2.0, 3.0)) is None
    assert watch.moved_mm((1.0, 5.0, 7.0)) == 5.0
    assert watch.moved_mm((1.0, 2.0, 3.0)) == 0.0
    assert DriftMonitor(1.0, (0.0, 0.0, 0.0)).moved_mm((0.0, 0.0, 2.0)) == 2.0


def air(temperature_degC: float) -> Weather:
    return Weather(temperature_degC, 1013.0, 50.0)


def test_alarm_of_the_air_ends_only_well_below_its_limit_and_needs_weather() -> None:
    watch = TemperatureMonitor(1.0, air(20.0))
    told = [bool(watch.events(air(t))) for t in (20.9, 21.05, 20.95, 21.05, 20.85, 20.7, 20.9)]
    assert told == [False, True, False, False, False, True, False]
    (event,) = TemperatureMonitor(1.0, air(20.0)).events(air(18.5))
    assert event.text == "the air has changed by -1.50 °C since the start, limit 1 °C"
    watch = TemperatureMonitor(1.0, None)
    assert watch.events(None) == ()
    assert watch.events(air(20.0)) == ()
    assert watch.events(air(21.5))
