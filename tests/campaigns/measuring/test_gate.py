"""The gate and the air: what may be data."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from fake_cell import NOMINAL, TRACKER_FROM_BASE
from goal_plans import OTHERS, PLAN
from par4_space import par4
from small_plans import FOUR_PAIRS, GATE

from campaigns.fit.error_model import ErrorModel
from campaigns.fit.error_sources import TRACKER_SOURCES
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.journal.records import Outcome
from campaigns.kinematics.model import Kinematics
from campaigns.measuring.gate import Gate
from campaigns.measuring.monitors import TemperatureMonitor
from campaigns.planning.plan_file import PlannedShot
from campaigns.settings.sections import GateConfig
from drivers.values import Weather

LONG_ARMED = par4(NOMINAL.parameters | {"arm1.forearm_mm": 710.0})
MODEL = ErrorModel(NOMINAL, TRACKER_SOURCES)
SHOTS = [shot for shot in PLAN if shot.shot not in OTHERS]


def outcome(shot: PlannedShot, off_mm: float = 0.0, truth: Kinematics = NOMINAL) -> Outcome:
    pose = truth.forward(np.array([shot.joints])).values_or_raise()[:, :3]
    point = TRACKER_FROM_BASE.apply(pose)[0] + (0.0, off_mm, 0.0)
    return Outcome(shot.shot, 1, shot.joints, tuple(point.tolist()), None, None, "", "", None)


def gate_of(accepted: Iterable[Outcome] = (), rules: GateConfig = GATE) -> Gate:
    return Gate(MODEL, TrackerUncertainty(), rules, accepted)


def gate_after(shots: int, rules: GateConfig = GATE) -> Gate:
    gate = gate_of(rules=rules)
    for shot in FOUR_PAIRS[:shots]:
        gate.accept(outcome(shot))
    return gate


NEXT = FOUR_PAIRS[9]


def test_before_the_fit_the_gate_judges_distances() -> None:
    first = replace(outcome(FOUR_PAIRS[0]), point_in_tracker_mm=(1.0, 2.0, 3.0))
    judged = gate_after(0).judge(first)
    assert (judged.refusal, judged.residual_mm, judged.predicted_in_tracker_mm) == ("", None, None)
    assert gate_after(1).judge(outcome(FOUR_PAIRS[1], 20.0)).refusal == ""
    refusal = gate_after(1).judge(outcome(FOUR_PAIRS[1], 2000.0)).refusal
    assert "the distance to an earlier shot is" in refusal
    assert "limit 60 mm: a wrong target or a wrong pose" in refusal


def test_known_robot_narrows_the_gate_but_never_widens_it() -> None:
    gate = gate_after(9)
    near = gate.judge(outcome(NEXT, 1.0))
    assert near.refusal == ""
    assert near.residual_mm == pytest.approx(1.0, abs=0.01)
    expected_mm = outcome(NEXT).point_in_tracker_mm
    assert near.predicted_in_tracker_mm == pytest.approx(expected_mm, abs=0.01)
    refusal = gate.judge(outcome(NEXT, 10.0)).refusal
    assert "10.00 mm from the predicted point, limit 3." in refusal
    strict = GATE.model_copy(update={"distance_mm": 0.5})
    assert "limit 0.50 mm" in gate_after(9, strict).judge(outcome(NEXT, 1.0)).refusal


@pytest.mark.parametrize("accepted", [1, 9])
def test_what_cannot_be_measured_is_refused(accepted: int) -> None:
    gate = gate_after(accepted)
    assert gate.judge(replace(outcome(NEXT), point_in_tracker_mm=(np.nan, 0.0, 0.0))).refusal
    impossible = tuple(np.radians([90.0, -90.0, 90.0, -90.0]).tolist())
    assert "cannot be assembled" in gate.judge(replace(outcome(NEXT), joints=impossible)).refusal


def test_tracker_is_pointed_where_the_pose_was_or_the_known_frame_has_it() -> None:
    there = FOUR_PAIRS[8]
    assert gate_after(3).expected_point_mm(there.joints) is None
    expected_mm = gate_after(8).expected_point_mm(there.joints)
    assert expected_mm == pytest.approx(outcome(there).point_in_tracker_mm, abs=0.01)
    drift, again = outcome(FOUR_PAIRS[0]), NEXT
    assert np.allclose(drift.joints, again.joints)
    assert gate_after(1).expected_point_mm(again.joints) == drift.point_in_tracker_mm


def test_forgotten_shot_is_as_if_it_had_never_been() -> None:
    spoilt = gate_after(5)
    spoilt.accept(outcome(FOUR_PAIRS[5], off_mm=40.0))
    spoilt.reset([5])
    assert spoilt.judge(outcome(NEXT)) == gate_after(5).judge(outcome(NEXT))


@pytest.mark.parametrize(("count", "wrong", "off_mm"), [(2, 0, 400.0), (11, 4, 100.0)])
def test_the_wrong_one_among_the_first_shots_is_the_suspect(
    count: int, wrong: int, off_mm: float
) -> None:
    shots = [outcome(shot, off_mm * (place == wrong)) for place, shot in enumerate(SHOTS[:count])]
    assert gate_of(shots).find_suspects(outcome(SHOTS[count])) == [shots[wrong]]


@pytest.mark.parametrize("count", [8, 13])
def test_no_shot_is_a_suspect_when_the_refused_one_is_wrong(count: int) -> None:
    accepted = map(outcome, SHOTS[:count])
    assert gate_of(accepted).find_suspects(outcome(SHOTS[count], 400.0)) == []


def test_shot_that_is_where_it_was_is_not_replaced() -> None:
    """Without it little is known, and the refused one could go with anything."""
    first, refused = outcome(FOUR_PAIRS[0]), outcome(FOUR_PAIRS[1])
    elsewhere = replace(first, point_in_tracker_mm=(0.0, 0.0, 0.0))
    assert not gate_of([first]).is_replaced_by(first, first, refused)
    assert gate_of([elsewhere]).is_replaced_by(first, elsewhere, refused)


def test_a_fit_predicts_ever_better_and_says_how_well() -> None:
    gate, errors, stated = gate_of(), [], []
    for shot in SHOTS:
        measured = outcome(shot, truth=LONG_ARMED)
        predicted = gate.predict(shot.joints)
        assert (predicted is None) == (len(gate.accepted) < 5)
        if predicted is not None:
            errors.append(np.linalg.norm(predicted[0] - measured.point_in_tracker_mm))
            stated.append(predicted[1])
        gate.accept(measured)
    assert np.all(np.array(errors) < 4.0 * np.array(stated))
    assert max(errors[-5:]) < 0.5 < 1.0 < max(errors[:5])
    assert stated[-1] < 0.2 * stated[0]


def test_shots_on_a_line_place_no_frame() -> None:
    points = [(2000.0 + 10.0 * row, 0.0, 0.0) for row in range(8)]
    shots = [replace(outcome(SHOTS[0]), point_in_tracker_mm=point) for point in points]
    assert gate_of(shots).predict(SHOTS[0].joints) is None


def test_alarm_of_the_air_ends_only_well_below_its_limit() -> None:
    monitor = TemperatureMonitor(1.0, None)
    degrees = (20.0, 20.9, 21.05, 20.95, 21.05, 20.85, 20.7, 20.9, 18.5)
    events = [monitor.events(Weather(degree, 1013.0, 50.0)) for degree in degrees]
    announced = [degree for degree, event in zip(degrees, events, strict=True) if event]
    assert announced == [21.05, 20.7, 18.5]
    text = "the air has changed by -1.50 °C since the start, limit 1 °C"
    assert events[-1][0].text == text
