"""The points behind the validation's figures, and the instrument's share in them."""

import numpy as np
import pytest
from fake_cell import TRACKER_FROM_BASE

from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.evaluation.validation import (
    MeasuredTest,
    base_from_tracker,
    distance_trace,
    line_traces,
    measured_test,
    of_set,
    radius_result,
    rotation_result,
)
from campaigns.journal.records import Intent, Outcome
from campaigns.journal.views import AcceptedShot
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Pose

MODEL = TrackerUncertainty()
JOINTS = (0.1, 0.2, 0.3, 0.4)


def shot(number: int, purpose: ShotSet, commanded, measured=None, pair=None) -> AcceptedShot:
    """A shot whose reflector was where it was commanded, or at `measured` in the base frame."""
    seen = TRACKER_FROM_BASE.apply(np.array([measured or commanded], dtype=float))[0]
    target = Pose(*map(float, commanded), theta_rad=0.0)
    intent = Intent(number, 1, purpose.value, target, JOINTS, "pose", pair)
    outcome = Outcome(number, 1, JOINTS, tuple(seen.tolist()), None, None, "", "", None)
    return AcceptedShot(intent, outcome, "2026-03-02T08:00:00Z")


def line(axis: int, bump_mm: float = 0.0) -> list[AcceptedShot]:
    """Five shots, the middle one lifted by the bump."""
    shots = []
    for number, place in enumerate((-200.0, -100.0, 0.0, 100.0, 200.0)):
        commanded = [0.0, 0.0, -575.0]
        commanded[axis] += place
        lifted = [*commanded[:2], commanded[2] + (bump_mm if number == 2 else 0.0)]
        shots.append(shot(number, ShotSet.STRAIGHTNESS, commanded, lifted))
    return shots


def in_base(shots) -> MeasuredTest:
    return measured_test(shots, MODEL).seen_from(TRACKER_FROM_BASE.inverted())


def with_deviations(points, deviations) -> MeasuredTest:
    """Points whose coordinates have these standard deviations."""
    points = np.array(points, dtype=float)
    commanded = np.column_stack([points, np.zeros(len(points))])
    covariance = np.tile(np.diag(np.square(deviations)), (len(points), 1, 1))
    return MeasuredTest((None,) * len(points), commanded, points, covariance)


def test_only_the_shots_of_the_set_are_taken() -> None:
    shots = [*line(0), shot(9, ShotSet.REPEATABILITY, (0, 0, -575))]
    assert len(of_set(shots, ShotSet.STRAIGHTNESS)) == 5


def test_a_line_keeps_its_axis_places_and_bump() -> None:
    (found,) = line_traces(in_base(line(1, bump_mm=1.0)))
    assert found.axis == "y"
    assert np.allclose(found.along_mm, [-200.0, -100.0, 0.0, 100.0, 200.0])
    assert found.away_mm[2] == pytest.approx([0.0, 0.0, 0.8], abs=1e-6)
    assert found.straightness.value_mm == pytest.approx(0.8, abs=1e-6)


def test_a_line_of_two_points_shows_no_straightness() -> None:
    assert line_traces(in_base(line(0)[:2])) == ()


def test_the_instrument_counts_in_the_direction_of_the_error() -> None:
    sideways = with_deviations([(0, 0, 0), (0, 1, 0)], (0.1, 0.2, 0.4))
    assert rotation_result(sideways).instrument_mm == pytest.approx(np.sqrt(2.0) * 0.2)
    along = with_deviations([(0, 0, 0), (1, 0, 0)], (0.1, 0.2, 0.4))
    assert rotation_result(along).instrument_mm == pytest.approx(np.sqrt(2.0) * 0.1)


def test_without_an_error_the_worst_direction_counts() -> None:
    same = with_deviations([(0, 0, 0), (0, 0, 0)], (0.1, 0.2, 0.4))
    assert radius_result(same).value_mm == 0.0
    assert radius_result(same).instrument_mm == pytest.approx(0.4)


def test_covariances_turn_with_the_points() -> None:
    stated = with_deviations([(1, 2, 3), (4, 5, 6)], (0.1, 0.2, 0.4))
    turned = stated.seen_from(TRACKER_FROM_BASE)
    back = turned.seen_from(TRACKER_FROM_BASE.inverted())
    assert np.allclose(back.covariance_mm2, stated.covariance_mm2)
    assert np.allclose(back.points_mm, stated.points_mm)
    assert not np.allclose(turned.covariance_mm2, stated.covariance_mm2)


def test_distances_are_of_whole_pairs_only() -> None:
    shots = [
        shot(0, ShotSet.VALIDATION, (0, 0, -500), pair=7),
        shot(1, ShotSet.VALIDATION, (100, 0, -500), (99, 0, -500), pair=7),
        shot(2, ShotSet.VALIDATION, (50, 0, -500), pair=8),
    ]
    found = distance_trace(measured_test(shots, MODEL))
    assert found.pairs == (7,)
    assert found.errors_mm == pytest.approx([1.0])


def test_three_points_or_a_line_fix_no_frame() -> None:
    corners = [(0, 0, -500), (100, 0, -500), (0, 100, -500), (0, 0, -600)]
    shots = [shot(k, ShotSet.VALIDATION, place) for k, place in enumerate(corners)]
    assert base_from_tracker(measured_test(shots, MODEL)) is not None
    assert base_from_tracker(measured_test(shots[:3], MODEL)) is None
    assert base_from_tracker(measured_test(line(0), MODEL)) is None


def test_nothing_measured_gives_no_result() -> None:
    empty = measured_test([], MODEL)
    assert distance_trace(empty) is None
    assert rotation_result(empty) is None
    assert radius_result(empty) is None
    assert line_traces(empty) == ()
