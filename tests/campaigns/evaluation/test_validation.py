"""The figures of a validation, each against data made by hand."""

import itertools

import numpy as np
import pytest
from fake_cell import TRACKER_FROM_BASE

from campaigns.evaluation.decision import NO_LIMIT
from campaigns.evaluation.iso_figures import cube_frame
from campaigns.evaluation.validation import (
    ValidationResult,
    distance_test,
    evaluate_validation,
    line_tests,
    repeatability_test,
    rotation_test,
)
from campaigns.evaluation.verdict import ValidationVerdict, limits_by_figure, validation_verdict
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.journal.records import Intent, Outcome
from campaigns.journal.views import AcceptedShot
from campaigns.kinematics.catalog import PAR4
from campaigns.settings.sections import AcceptanceConfig
from campaigns.shots.shot_sets import ShotSet, pair_rows
from campaigns.shots.shots import shots_of_journal
from drivers.values import Pose

JOINTS = (0.1, 0.2, 0.3, 0.4)
MIDDLE = (0.0, 0.0, -575.0)
INSTRUMENT = TrackerUncertainty()


def shot(number, purpose, commanded, measured=None, pair=None) -> AcceptedShot:
    """A shot whose reflector was where it was commanded, or at `measured` in the base frame."""
    place = np.array(commanded if measured is None else measured, dtype=float)
    seen = TRACKER_FROM_BASE.apply(place[None])[0]
    target = Pose(*map(float, commanded), theta_rad=0.0)
    intent = Intent(number, 1, purpose.value, target, JOINTS, "pose", pair)
    outcome = Outcome(number, 1, JOINTS, tuple(seen.tolist()), None, None, "", "", None)
    return AcceptedShot(intent, outcome, "2026-03-02T08:00:00Z")


def line(axis: int, points: int = 5, first: int = 0, bump_mm=None) -> list[AcceptedShot]:
    """Shots along a straight line, the middle one measured off it by the bump."""
    places = np.array(MIDDLE) + np.outer(np.linspace(-200.0, 200.0, points), np.eye(3)[axis])
    measured = places.copy()
    if bump_mm is not None:
        measured[points // 2] += bump_mm
    return [
        shot(first + row, ShotSet.STRAIGHTNESS, *both)
        for row, both in enumerate(zip(places, measured, strict=True))
    ]


def pairs(errors_mm: list[float]) -> list[AcceptedShot]:
    """Pairs along x, 300 mm commanded and `errors_mm` longer or shorter in truth."""
    shots = []
    along = np.eye(3)[0]
    for number, error in enumerate(errors_mm):
        here = np.array([-150.0, 40.0 * number, -500.0 - 30.0 * number])
        there = here + 300.0 * along
        kind = ShotSet.VALIDATION
        shots.append(shot(2 * number, kind, here, pair=number))
        shots.append(shot(2 * number + 1, kind, there, there + error * along, pair=number))
    return shots


def validated(accepted, instrument=INSTRUMENT) -> ValidationResult:
    return evaluate_validation(shots_of_journal(accepted, PAR4), instrument)


CENTRE_MM = np.array([10.0, 20.0, 30.0])
QUIET = TrackerUncertainty(1e-6, 0.0, 1e-6, 0.0)
ALL_LIMITS = AcceptanceConfig(**dict.fromkeys(AcceptanceConfig.model_fields, 1.0))


def measured(points, commanded=0.0, deviations=(0.01, 0.01, 0.01)):
    """Points (N, 3) of a test, commanded in one place or at (N, 3), with 1 σ by coordinate."""
    points = np.array(points, dtype=float)
    poses = np.zeros((len(points), 4))
    poses[:, :3] = commanded
    return poses, points, np.tile(np.diag(np.square(deviations)), (len(points), 1, 1))


def straightness_mm(points) -> float:
    """Of points (N, 3) commanded along x."""
    along_x = np.outer(np.arange(len(points)), np.eye(3)[0])
    (found,) = line_tests(*measured(points, along_x))
    return found.straightness.value_mm


def decision_on(found: ValidationVerdict, name: str) -> str | None:
    return next(each.decision for each in found.requirements if each.name == name)


def test_straightness_is_the_largest_distance_from_the_best_line_in_any_frame() -> None:
    points = np.zeros((5, 3))
    points[:, 0] = [-200.0, -100.0, 0.0, 100.0, 200.0]
    assert straightness_mm(points) == pytest.approx(0.0, abs=1e-12)
    points[2, 1] = 1.0  # the best line is lifted by the mean, 0.2: the bump stands 0.8 out
    assert straightness_mm(points) == pytest.approx(0.8, abs=1e-9)
    points = np.random.default_rng(1).normal(0.0, 0.1, (9, 3))
    points[:, 2] += np.linspace(0.0, 500.0, 9) ** 1.1
    turned = TRACKER_FROM_BASE.apply(points)
    assert straightness_mm(turned) == pytest.approx(straightness_mm(points), abs=1e-9)


def test_each_line_is_recognised_by_its_axis_and_one_point_is_none() -> None:
    found = validated([*line(0), *line(1, first=5, bump_mm=(0.0, 0.0, 1.0)), *line(2, first=10)])
    straight = {each.axis: each.straightness.value_mm for each in found.lines}
    assert straight == pytest.approx({"x": 0.0, "y": 0.8, "z": 0.0}, abs=1e-9)
    # without pairs the frame is that of all shots
    assert found.line("y").away_mm[2] == pytest.approx([0.0, 0.0, 0.8], abs=0.01)
    assert found.absolute_mm is None
    assert [each.axis for each in validated(line(2)).lines] == ["z"]
    assert validated(line(0)[:2]).lines == ()


def test_rotation_is_the_largest_distance_between_any_two_points() -> None:
    angle = np.linspace(0.0, np.pi, 19)
    half_circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(19)])
    assert rotation_test(*measured(0.5 * half_circle)).moved.value_mm == pytest.approx(1.0)
    assert rotation_test(*measured(half_circle[:1])) is None


def test_repeatability_of_points_on_a_sphere_is_its_radius() -> None:
    directions = np.vstack([np.eye(3), -np.eye(3)])
    found = repeatability_test(*measured(CENTRE_MM + 0.4 * directions), in_base=False)
    assert found.radius.value_mm == pytest.approx(0.4)
    assert found.rp.value_mm == pytest.approx(0.4)


def test_distance_errors_are_those_of_whole_pairs() -> None:
    found = validated(pairs([0.3, -0.6, 0.0])).distances
    assert found.mean.value_mm == pytest.approx(0.3)
    assert found.largest.value_mm == pytest.approx(0.6)
    broken_pair = validated(pairs([0.3, -0.6])[:-1]).distances
    assert broken_pair.pairs == (0,)
    assert broken_pair.largest.value_mm == pytest.approx(0.3)
    assert validated(pairs([0.3])[:-1]).distances is None


def test_absolute_accuracy_is_what_no_frame_can_explain() -> None:
    corners = np.array([*itertools.product((0.0, 400.0), (0.0, 400.0), (0.0, 300.0))])

    def away_mm(commanded):
        both = enumerate(zip(commanded, corners, strict=True))
        return validated([shot(n, ShotSet.VALIDATION, *each) for n, each in both]).absolute_mm

    exact = away_mm(corners)
    assert (exact.mean(), exact.max()) == pytest.approx((0.0, 0.0), abs=1e-9)
    grown = away_mm(1.001 * corners)
    half_diagonal = np.linalg.norm([200.0, 200.0, 150.0])
    assert (grown.mean(), grown.max()) == pytest.approx((0.001 * half_diagonal,) * 2, rel=1e-6)
    for few_or_in_line in (corners[:3], np.outer(np.arange(6.0), (100.0, 0.0, 0.0))):
        exact = [shot(n, ShotSet.VALIDATION, place) for n, place in enumerate(few_or_in_line)]
        assert validated(exact).absolute_mm is None


def test_test_that_was_not_run_is_null() -> None:
    found = validated(line(0))
    document = found.document()
    assert document.pop("straightness_mm") == {"x": found.line("x").straightness.value_mm}
    assert set(document.values()) == {None}
    assert found.series == {"straightness": 0}
    assert set(validated([]).figures().values()) == {None}


DEVIATIONS = (0.1, 0.2, 0.4)


def test_the_instrument_counts_in_the_direction_of_the_error_or_in_the_worst() -> None:
    sideways = measured([(0, 0, 0), (0, 1, 0)], deviations=DEVIATIONS)
    moved = rotation_test(*sideways).moved
    assert moved.expanded_uncertainty_mm == pytest.approx(2.0 * np.sqrt(2.0) * 0.2)
    along = measured([(0, 0, 0), (1, 0, 0)], deviations=DEVIATIONS)
    assert rotation_test(*along).moved.standard_uncertainty_mm == pytest.approx(np.sqrt(2.0) * 0.1)
    same = measured([(0, 0, 0), (0, 0, 0)], deviations=DEVIATIONS)
    radius = repeatability_test(*same, in_base=True).radius
    assert radius.value_mm == 0.0
    assert radius.standard_uncertainty_mm == pytest.approx(0.4)


def test_each_distance_has_the_uncertainty_along_it_and_averaging_takes_nothing_off() -> None:
    points = [(0, 0, 0), (9, 0, 0), (0, 0, 5), (0, 7, 5)]
    commanded, *seen = measured(points, points, DEVIATIONS)
    commanded[3, 1] = 5.0
    found = distance_test(pair_rows((3, 3, 4, 4)), commanded, *seen)
    assert found.standard_uncertainty_mm == pytest.approx(np.sqrt(2.0) * np.array([0.1, 0.2]))
    assert found.mean.standard_uncertainty_mm == pytest.approx(np.sqrt(2.0) * 0.15)
    assert found.largest.value_mm == pytest.approx(2.0)
    assert found.largest.standard_uncertainty_mm == pytest.approx(np.sqrt(2.0) * 0.2)


@pytest.fixture(scope="module")
def whole() -> ValidationResult:
    """Of a series with every test."""
    kind = ShotSet.REPEATABILITY
    repeated = [shot(90 + n, kind, (0, 0, -575), (0.1 * n, 0, -575)) for n in range(3)]
    turned = [shot(80 + n, ShotSet.ROTATION, (0, 0, -575), (0, 0.2 * n, -575)) for n in range(3)]
    lines = [*line(0, first=20), *line(1, first=30), *line(2, first=40)]
    return validated([*pairs([0.3, -0.6, 0.1]), *lines, *turned, *repeated, *cube_shots()])


def test_every_figure_has_its_limit_and_meets_it(whole: ValidationResult) -> None:
    without_limits = validation_verdict(whole, AcceptanceConfig())
    assert (without_limits.decision, without_limits.reasons) == (NO_LIMIT, ())
    verdict = validation_verdict(whole, ALL_LIMITS)
    assert (verdict.decision, verdict.reasons) == ("pass", ())
    assert limits_by_figure(ALL_LIMITS).keys() == whole.figures().keys()
    assert set(limits_by_figure(ALL_LIMITS).values()) == {1.0}


def test_every_figure_is_in_the_document(whole: ValidationResult) -> None:
    document = whole.document()
    assert document["distances_mm"] == pytest.approx({"mean_abs": 1.0 / 3.0, "max_abs": 0.6})
    assert document["rotation_mm"] == pytest.approx(0.4)
    assert document["straightness_mm"].keys() == {"x", "y", "z"}
    assert document["repeatability"]["radius_mm"] == pytest.approx(0.1)
    assert document["repeatability"]["approaches"] == 3
    assert 0.0 < document["frame_mm"]["mean"] < document["frame_mm"]["max"] < 0.6


def test_broken_limits_are_named_with_value_and_limit() -> None:
    found = validated([*pairs([0.3, -0.6, 0.0]), *line(1, first=30, bump_mm=(0.0, 0.0, 1.0))])
    limits = AcceptanceConfig(
        distance_mean_mm=0.4, distance_max_mm=0.5, straightness_mm=0.5, rotation_mm=0.1
    )
    verdict = validation_verdict(found, limits)
    broken = [each for each in verdict.requirements if each.decision == "fail"]
    assert [each.name for each in broken] == ["distances, largest error", "straightness along y"]
    assert [each.error for each in broken] == pytest.approx([0.6, 0.8])
    expanded_mm = found.distances.largest.expanded_uncertainty_mm
    words = f"distances, largest error 0.600 ± {expanded_mm:.3f} mm, limit 0.5 mm: fail"
    assert words in verdict.reasons
    assert verdict.decision == "fail"
    assert decision_on(verdict, "distances, mean error") == "pass"


def test_a_limit_without_a_measurement_or_within_its_uncertainty_is_not_decided() -> None:
    verdict = validation_verdict(validated(pairs([0.3, -0.6])), ALL_LIMITS)
    assert verdict.decision == "not decided"
    assert "rotation not measured, limit 1 mm" in verdict.reasons
    nothing = validation_verdict(None, ALL_LIMITS)
    assert {each.decision for each in nothing.requirements} == {"not decided"}
    limits = AcceptanceConfig(distance_max_mm=0.6)
    loud = TrackerUncertainty(0.1, 0.0, 0.1, 0.0)
    for error_mm, instrument, decision in (
        (-0.59, loud, "not decided"),
        (-0.59, QUIET, "pass"),
        (-0.61, QUIET, "fail"),
    ):
        found = validated(pairs([0.3, error_mm]), instrument)
        assert validation_verdict(found, limits).decision == decision


# Visits to P1 in the middle and P2 to P5 about it; commanded as in ISO 9283, order P5 to P1.
CUBE = [(-80, 80, -495), (80, 80, -495), (80, -80, -655), (-80, -80, -655), (0, 0, -575)]
VISITS = ((0.1, 0.3, 0.0), (0.3, 0.3, 0.0), (0.2, 0.2, 0.0), (0.2, 0.4, 0.0))
"""From the commanded place. Their mean is (0.2, 0.3, 0): AP = √0.13; each is 0.1 from it: l̄ = 0.1,
S = 0, RP = 0.1."""
FAR = ((0.0, 0.0, 0.3), (0.0, 0.0, -0.1), (0.0, 0.0, 0.1), (0.0, 0.0, 0.1))
"""Mean (0, 0, 0.1): AP = 0.1; distances 0.2, 0.2, 0, 0: l̄ = 0.1, S = √(0.04/3), RP = 0.1 + 3 S."""


def cube_shots(first: int = 200, off_mm: float = 0.0) -> list:
    """Four cycles; encoders read `off_mm` more from cycle to cycle."""
    return [
        shot(
            first + 5 * cycle + place,
            ShotSet.ISO_CUBE,
            np.add(at, off_mm * cycle),
            np.add(at, (FAR if place == 3 else VISITS)[cycle]),
        )
        for cycle in range(4)
        for place, at in enumerate(CUBE)
    ]


def test_ap_and_rp_are_those_of_the_standard_worked_by_hand() -> None:
    found = validated([*pairs([0.0] * 8), *cube_shots()], TrackerUncertainty())
    commanded = np.array([each.commanded_mm for each in found.cube])
    assert commanded == pytest.approx(np.array(CUBE[::-1], dtype=float))
    rp = 0.1 + 3.0 * (0.04 / 3.0) ** 0.5
    for place, each in enumerate(found.cube):
        far = place == 1
        assert each.accuracy.value_mm == pytest.approx(0.1 if far else 0.13**0.5)
        assert each.rp.value_mm == pytest.approx(rp if far else 0.1)
        parts = (0.0, 0.0, 0.1) if far else (0.2, 0.3, 0.0)
        assert [part.value_mm for part in each.components] == pytest.approx(parts, abs=1e-9)
        across_mm = 0.0 if far else (0.02 / 3.0 / 4.0) ** 0.5  # of the mean of four visits
        scatter = (across_mm, across_mm, (0.08 / 3.0 / 4.0) ** 0.5 if far else 0.0)
        for part, own_mm, axis in zip(each.components, scatter, np.eye(3), strict=True):
            by_tracker = axis @ each.instrument_mm2 @ axis
            assert part.standard_uncertainty_mm == pytest.approx(np.hypot(own_mm, by_tracker**0.5))
    assert [each.value_mm for each in found.worst_of_cube] == pytest.approx([0.13**0.5, rp])
    p2 = found.document()["iso9283"][1]
    assert (p2["pose"], p2["visits"], p2["rp_mm"]) == ("P2", 4, pytest.approx(rp))
    assert (p2["ap_mm"], p2["ap_z_mm"]) == pytest.approx((0.1, 0.1))


def test_ap_has_the_scatter_of_the_mean_and_the_instrument_in_its_uncertainty() -> None:
    shift = np.array([4.0, 0.0, 0.0])
    cross = np.vstack([np.eye(3), -np.eye(3)]) + shift  # along x: 5, 3 and four times 4
    poses, covariance = np.zeros((6, 4)), np.tile(0.3**2 * np.eye(3), (6, 1, 1))
    poses[:, 1] = 3.0
    accuracy = repeatability_test(poses, cross, covariance, in_base=True).accuracy
    assert accuracy.value_mm == pytest.approx(5.0)
    poses[:, 1] = 0.0
    accuracy = repeatability_test(poses, cross, covariance, in_base=True).accuracy
    of_mean = np.sqrt(2.0 / 5.0 / 6.0)
    assert accuracy.standard_uncertainty_mm == pytest.approx(np.hypot(of_mean, 0.3))


def test_the_uncertainty_of_rp_is_what_other_samples_scatter() -> None:
    rng = np.random.default_rng(1)
    samples = [measured(rng.normal(size=(28, 3))) for _ in range(400)]
    figures = [repeatability_test(*sample, in_base=True).rp for sample in samples]
    scatter = np.std([rp.value_mm for rp in figures])
    stated = np.mean([rp.standard_uncertainty_mm for rp in figures])
    assert stated == pytest.approx(scatter, rel=0.2)


def test_poses_as_encoders_read_them_are_told_apart_and_alone_fix_the_frame() -> None:
    alone = validated(cube_shots(off_mm=0.05))
    assert [len(each.points_mm) for each in alone.cube] == [4] * 5
    assert cube_frame(alone) == "frame fitted to these poses alone"
    both = validated([*pairs([0.0] * 4), *cube_shots()])
    assert cube_frame(both) == "frame fitted to the pairs"
    assert len(validated(cube_shots()[:7]).cube) == 2  # of which there are two visits


def test_limits_of_the_cube_are_judged_and_not_asked_of_others() -> None:
    found = validated([*pairs([0.0] * 8), *cube_shots()])
    limits = AcceptanceConfig(pose_accuracy_mm=0.1, pose_repeatability_mm=2.0)
    verdict = validation_verdict(found, limits)
    assert decision_on(verdict, "pose accuracy AP, worst") == "fail"
    assert decision_on(verdict, "pose repeatability RP, worst") == "pass"
    other = validated(line(0))
    names = {each.name for each in validation_verdict(other, AcceptanceConfig()).requirements}
    assert "pose accuracy AP, worst" not in names
    judged = validation_verdict(other, limits)
    assert decision_on(judged, "pose accuracy AP, worst") == "not decided"
