"""The figures of a validation, each against data made by hand."""

from dataclasses import replace

import numpy as np
import pytest
from fake_cell import TRACKER_FROM_BASE

from campaigns.evaluation.validation import (
    broken_limits,
    evaluate_validation,
    frame_errors,
    line_axes,
    repeatability,
    rotation_mm,
    straightness_mm,
)
from campaigns.journal.records import Intent, Outcome
from campaigns.journal.views import AcceptedShot
from campaigns.settings.sections import AcceptanceConfig
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Pose

JOINTS = (0.1, 0.2, 0.3, 0.4)


def shot(
    number: int, purpose: ShotSet, commanded, measured=None, pair: int | None = None
) -> AcceptedShot:
    """A shot whose reflector was where it was commanded, or at `measured` in the base frame."""
    seen = TRACKER_FROM_BASE.apply(np.array([commanded if measured is None else measured]))[0]
    target = Pose(*map(float, commanded), theta_rad=0.0)
    intent = Intent(number, 1, purpose.value, target, JOINTS, "pose", pair)
    outcome = Outcome(number, 1, JOINTS, tuple(seen.tolist()), None, None, "", "", None)
    return AcceptedShot(intent, outcome, "2026-03-02T08:00:00Z")


def line(axis: int, points: int = 5, first: int = 0) -> list[AcceptedShot]:
    offsets = np.outer(np.linspace(-200.0, 200.0, points), np.eye(3)[axis])
    centre = np.array([0.0, 0.0, -575.0])
    return [
        shot(first + place, ShotSet.STRAIGHTNESS, centre + offset)
        for place, offset in enumerate(offsets)
    ]


def bumped(shots: list[AcceptedShot], row: int, bump_mm) -> list[AcceptedShot]:
    moved = shots[row].intent.target
    place = np.array([moved.x_mm, moved.y_mm, moved.z_mm]) + bump_mm
    bump = shot(shots[row].intent.shot, ShotSet.STRAIGHTNESS, (0, 0, 0), place).outcome
    return [*shots[:row], replace(shots[row], outcome=bump), *shots[row + 1 :]]


def test_straightness_of_a_line_with_one_bump_is_its_distance_from_the_best_line() -> None:
    points = np.zeros((5, 3))
    points[:, 0] = [-200.0, -100.0, 0.0, 100.0, 200.0]
    assert straightness_mm(points) == pytest.approx(0.0, abs=1e-12)
    points[2, 1] = 1.0  # the best line is lifted by the mean, 0.2: the bump stands 0.8 out
    assert straightness_mm(points) == pytest.approx(0.8, abs=1e-9)


def test_straightness_does_not_depend_on_the_frame_or_on_the_spacing() -> None:
    points = np.random.default_rng(1).normal(0.0, 0.1, (9, 3))
    points[:, 2] += np.linspace(0.0, 500.0, 9) ** 1.1
    turned = TRACKER_FROM_BASE.apply(points)
    assert straightness_mm(turned) == pytest.approx(straightness_mm(points), abs=1e-9)


def test_each_axis_has_its_own_straightness() -> None:
    shots = [*line(0), *bumped(line(1, first=5), 2, (0.0, 0.0, 1.0)), *line(2, first=10)]
    found = evaluate_validation(shots).straightness_mm
    assert found == pytest.approx({"x": 0.0, "y": 0.8, "z": 0.0}, abs=1e-9)


@pytest.mark.parametrize("points", [3, 4, 5, 17])
def test_lines_are_recognised_by_what_was_commanded(points: int) -> None:
    shots = [shot for axis in range(3) for shot in line(axis, points)]
    commanded = np.array(
        [(s.intent.target.x_mm, s.intent.target.y_mm, s.intent.target.z_mm) for s in shots]
    )
    assert line_axes(commanded).tolist() == [0] * points + [1] * points + [2] * points


def test_one_line_alone_is_recognised() -> None:
    assert evaluate_validation(line(2)).straightness_mm == {"z": pytest.approx(0.0, abs=1e-9)}


def test_single_point_is_no_line() -> None:
    assert evaluate_validation(line(0)[2:3]).straightness_mm is None
    assert evaluate_validation(line(0)[:2]).straightness_mm is None


def test_rotation_is_the_largest_distance_between_any_two_points() -> None:
    angle = np.linspace(0.0, np.pi, 19)
    half_circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(19)])
    assert rotation_mm(0.5 * half_circle) == pytest.approx(1.0)
    assert rotation_mm(half_circle[:1]) is None


def test_repeatability_of_points_on_a_sphere_is_its_radius() -> None:
    directions = np.vstack([np.eye(3), -np.eye(3)])
    found = repeatability(np.array([10.0, 20.0, 30.0]) + 0.4 * directions)
    assert found.radius_mm == pytest.approx(0.4)
    assert found.rp_mm == pytest.approx(0.4)
    assert found.approaches == 6


def test_rp_is_mean_plus_three_standard_deviations() -> None:
    """Two pairs of opposite points: lengths 1, 1, 3, 3, so mean 2 and S = 2 / sqrt(3)."""
    points = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, -3.0, 0.0]])
    found = repeatability(points)
    assert found.rp_mm == pytest.approx(2.0 + 3.0 * 2.0 / 3.0**0.5)
    assert found.radius_mm == pytest.approx(3.0)
    assert repeatability(points[:1]) is None


def pairs(errors_mm: list[float]) -> list[AcceptedShot]:
    """Pairs along x, 300 mm commanded and `errors_mm` longer or shorter in truth."""
    shots = []
    for number, error in enumerate(errors_mm):
        here = np.array([-150.0, 40.0 * number, -500.0 - 30.0 * number])
        there = here + 300.0 * np.eye(3)[0]
        kind = ShotSet.VALIDATION
        shots.append(shot(2 * number, kind, here, pair=number))
        shots.append(shot(2 * number + 1, kind, there, there + error * np.eye(3)[0], pair=number))
    return shots


def test_distance_errors_are_those_of_the_pairs() -> None:
    found = evaluate_validation(pairs([0.3, -0.6, 0.0])).distances
    assert found.mean_abs == pytest.approx(0.3)
    assert found.max_abs == pytest.approx(0.6)


def test_half_a_pair_is_no_distance() -> None:
    assert evaluate_validation(pairs([0.3, -0.6])[:-1]).distances.max_abs == pytest.approx(0.3)
    assert evaluate_validation(pairs([0.3])[:-1]).distances is None


def test_absolute_accuracy_is_what_no_frame_can_explain() -> None:
    corners = np.array(
        [[x, y, z] for x in (0.0, 400.0) for y in (0.0, 400.0) for z in (0.0, 300.0)]
    )
    seen = TRACKER_FROM_BASE.apply(corners)
    exact = frame_errors(corners, seen)
    assert (exact.mean, exact.max) == pytest.approx((0.0, 0.0), abs=1e-9)
    grown = frame_errors(1.001 * corners, seen)
    half_diagonal = np.linalg.norm([200.0, 200.0, 150.0])
    assert grown.mean == pytest.approx(0.001 * half_diagonal, rel=1e-6)
    assert grown.max == pytest.approx(0.001 * half_diagonal, rel=1e-6)


def test_points_that_fix_no_frame_give_no_accuracy() -> None:
    on_a_line = np.outer(np.arange(6.0), (100.0, 0.0, 0.0))
    assert frame_errors(on_a_line, on_a_line) is None
    assert frame_errors(np.eye(3), np.eye(3)) is None


def test_test_that_was_not_run_is_null() -> None:
    found = evaluate_validation(line(0))
    assert found.document() == {
        "distances_mm": None,
        "rotation_mm": None,
        "straightness_mm": {"x": found.straightness_mm["x"]},
        "repeatability": None,
        "frame_mm": None,
    }
    assert evaluate_validation([]).straightness_mm is None


def test_document_has_every_figure() -> None:
    kind = ShotSet.REPEATABILITY
    repeated = [shot(90 + n, kind, (0, 0, -575), (0.1 * n, 0, -575)) for n in range(3)]
    turned = [shot(80 + n, ShotSet.ROTATION, (0, 0, -575), (0, 0.2 * n, -575)) for n in range(3)]
    lines = [*line(0, first=20), *line(1, first=30), *line(2, first=40)]
    document = evaluate_validation(
        [*pairs([0.3, -0.6, 0.1]), *lines, *turned, *repeated]
    ).document()
    assert document["distances_mm"] == pytest.approx({"mean_abs": 1.0 / 3.0, "max_abs": 0.6})
    assert document["rotation_mm"] == pytest.approx(0.4)
    assert document["straightness_mm"].keys() == {"x", "y", "z"}
    assert document["repeatability"]["radius_mm"] == pytest.approx(0.1)
    assert document["repeatability"]["approaches"] == 3
    assert 0.0 < document["frame_mm"]["mean"] < document["frame_mm"]["max"] < 0.6


def test_broken_limits_are_named_with_value_and_limit() -> None:
    found = evaluate_validation(
        [*pairs([0.3, -0.6, 0.0]), *bumped(line(1, first=30), 2, (0.0, 0.0, 1.0))]
    )
    limits = AcceptanceConfig(
        distance_mean_mm=0.4, distance_max_mm=0.5, straightness_mm=0.5, rotation_mm=0.1
    )
    assert broken_limits(found, limits) == [
        "largest distance error 0.600 mm, limit 0.5 mm",
        "straightness 0.800 mm, limit 0.5 mm",
    ]
    assert broken_limits(found, AcceptanceConfig()) == []
