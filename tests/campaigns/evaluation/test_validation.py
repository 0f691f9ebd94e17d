"""The figures of a validation, each against data made by hand."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from fake_cell import TRACKER_FROM_BASE
from scipy.spatial.transform import Rotation

from campaigns.evaluation.decision import NO_LIMIT
from campaigns.evaluation.iso_figures import cube_frame
from campaigns.evaluation.measured_lengths import PointNoise
from campaigns.evaluation.validation import (
    distance_test,
    evaluate_validation,
    line_tests,
    repeatability_test,
    rotation_test,
)
from campaigns.evaluation.verdict import limits_by_figure, validation_verdict
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.settings.sections import AcceptanceConfig
from campaigns.shots.shot_sets import ShotSet, pair_rows
from campaigns.shots.shots import Shots

MIDDLE = np.array([0.0, 0.0, -575.0])
INSTRUMENT = TrackerUncertainty()
LOUD = TrackerUncertainty(0.1, 0.0, 0.1, 0.0)
QUIET = TrackerUncertainty(1e-6, 0.0, 1e-6, 0.0)
ALL_LIMITS = AcceptanceConfig(**dict.fromkeys(AcceptanceConfig.model_fields, 1.0))


def shots_for(purpose, commanded, measured=None, pairs=None):
    """Rows of shots: purpose, commanded place, measured place in the base frame, and pair."""
    measured = commanded if measured is None else measured
    pairs = [None] * len(commanded) if pairs is None else pairs
    return [(purpose, *row) for row in zip(commanded, measured, pairs, strict=True)]


def validated(rows, instrument=INSTRUMENT, turns_rad=0.0, lever_mm=(0.0, 0.0, 0.0)):
    """Of a platform with one turn, and a reflector at a lever from the controlled point."""
    count = len(rows)
    purposes, commanded, measured, pairs = zip(*rows, strict=True) if rows else ((),) * 4
    poses, points = np.zeros((count, 4)), np.reshape(measured, (count, 3))
    poses[:, :3], poses[:, 3] = np.reshape(commanded, (count, 3)), turns_rad
    turned = [Rotation.from_rotvec((0.0, 0.0, turn)).apply(lever_mm) for turn in poses[:, 3]]
    levers = np.reshape(turned, (count, 3))
    shots = Shots(
        numbers=tuple(range(count)), purposes=tuple(purposes), pairs=tuple(pairs),
        joints=np.zeros((count, 4)), approach=np.zeros((count, 4)), commanded=poses,
        points_in_tracker_mm=TRACKER_FROM_BASE.apply(points),
        stated_covariance_mm2=np.full((count, 3, 3), np.nan),
        measured_utc=("",) * count, temperature_degC=np.full(count, np.nan),
        commanded_points_mm=poses[:, :3] + levers,
    )  # fmt: skip
    return evaluate_validation(shots, instrument)


def line(axis, points=5, bump_mm=(0.0, 0.0, 0.0)):
    """Shots along a straight line, the middle one measured off it by the bump."""
    places = MIDDLE + np.outer(np.linspace(-200.0, 200.0, points), np.eye(3)[axis])
    measured = places.copy()
    measured[points // 2] += bump_mm
    return shots_for(ShotSet.STRAIGHTNESS, places, measured)


def pairs(errors_mm):
    """Pairs along x, 300 mm commanded and `errors_mm` longer or shorter in truth."""
    rows = []
    for number, error in enumerate(errors_mm):
        y, z = 40.0 * number, -500.0 - 30.0 * number
        commanded = [(-150.0, y, z), (150.0, y, z)]
        measured = [(-150.0, y, z), (150.0 + error, y, z)]
        rows += shots_for(ShotSet.VALIDATION, commanded, measured, [number, number])
    return rows


def measured(points, commanded=0.0, deviations=(0.01, 0.01, 0.01)):
    """Points (N, 3) of a test, commanded in one place or at (N, 3), with 1 σ by coordinate."""
    points = np.array(points, dtype=float)
    poses = np.zeros((len(points), 4))
    poses[:, :3] = commanded
    instrument = np.tile(np.diag(np.square(deviations)), (len(points), 1, 1))
    return poses, points, PointNoise(instrument, np.zeros_like(instrument))


def straightness_mm(points):
    """Of points (N, 3) commanded along x."""
    along_x = np.outer(np.arange(len(points)), np.eye(3)[0])
    (test,) = line_tests(*measured(points, along_x))
    return test.straightness.value_mm


def decision_on(verdict, name):
    return next(each.decision for each in verdict.requirements if each.name == name)


def test_straightness_is_the_largest_distance_from_the_best_line_in_any_frame():
    points = np.zeros((5, 3))
    points[:, 0] = [-200.0, -100.0, 0.0, 100.0, 200.0]
    assert straightness_mm(points) == pytest.approx(0.0, abs=1e-12)
    points[2, 1] = 1.0  # the best line is lifted by the mean, 0.2: the bump stands 0.8 out
    assert straightness_mm(points) == pytest.approx(0.8, abs=1e-9)
    points = np.random.default_rng(1).normal(0.0, 0.1, (9, 3))
    points[:, 2] += np.linspace(0.0, 500.0, 9) ** 1.1
    turned = TRACKER_FROM_BASE.apply(points)
    assert straightness_mm(turned) == pytest.approx(straightness_mm(points), abs=1e-9)


def test_each_line_is_recognised_by_its_axis_and_two_points_are_none():
    result = validated([*line(0), *line(1, bump_mm=(0.0, 0.0, 1.0)), *line(2)])
    straight = {each.axis: each.straightness.value_mm for each in result.lines}
    assert straight == pytest.approx({"x": 0.0, "y": 0.8, "z": 0.0}, abs=1e-9)
    # without pairs the frame is that of all shots
    assert result.line("y").away_mm[2] == pytest.approx([0.0, 0.0, 0.8], abs=0.01)
    assert result.absolute_mm is None
    assert [each.axis for each in validated(line(2)).lines] == ["z"]
    assert validated(line(0)[:2]).lines == ()


def test_rotation_is_the_largest_distance_between_any_two_points():
    angle = np.linspace(0.0, np.pi, 19)
    half_circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(19)])
    assert rotation_test(*measured(0.5 * half_circle)).moved.value_mm == pytest.approx(1.0)
    assert rotation_test(*measured(half_circle[:1])) is None


def test_shots_of_a_rotation_say_nothing_of_a_platform_that_does_not_turn():
    commanded, points, noise = measured(np.eye(3))
    assert rotation_test(commanded[:, :3], points, noise) is None


def test_distance_errors_are_those_of_whole_pairs():
    test = validated(pairs([0.3, -0.6, 0.0])).distances
    assert test.mean.value_mm == pytest.approx(0.3)
    assert test.largest.value_mm == pytest.approx(0.6)
    without_one_end = validated(pairs([0.3, -0.6])[:-1]).distances
    assert without_one_end.pairs == (0,)
    assert without_one_end.largest.value_mm == pytest.approx(0.3)
    assert validated(pairs([0.3])[:-1]).distances is None


def test_absolute_accuracy_is_what_no_frame_can_explain():
    def away_mm(commanded, points):
        return validated(shots_for(ShotSet.VALIDATION, commanded, points)).absolute_mm

    corners = np.array([*product((0.0, 400.0), (0.0, 400.0), (0.0, 300.0))])
    assert away_mm(corners, corners).max() == pytest.approx(0.0, abs=1e-9)
    grown_mm = away_mm(1.001 * corners, corners)
    half_diagonal = np.linalg.norm([200.0, 200.0, 150.0])
    assert (grown_mm.mean(), grown_mm.max()) == pytest.approx(
        (0.001 * half_diagonal,) * 2, rel=1e-6
    )
    for few_or_in_line in (corners[:3], np.outer(np.arange(6.0), (100.0, 0.0, 0.0))):
        assert away_mm(few_or_in_line, few_or_in_line) is None


DEVIATIONS = (0.1, 0.2, 0.4)


def test_the_instrument_counts_in_the_direction_of_the_error_or_in_the_worst():
    sideways = measured([(0, 0, 0), (0, 1, 0)], deviations=DEVIATIONS)
    moved = rotation_test(*sideways).moved
    assert moved.expanded_uncertainty_mm == pytest.approx(2.0 * np.sqrt(2.0) * 0.2)
    along = measured([(0, 0, 0), (1, 0, 0)], deviations=DEVIATIONS)
    assert rotation_test(*along).moved.standard_uncertainty_mm == pytest.approx(np.sqrt(2.0) * 0.1)
    same = measured([(0, 0, 0), (0, 0, 0)], deviations=DEVIATIONS)
    radius = repeatability_test(*same, in_base=True).radius
    assert (radius.value_mm, radius.standard_uncertainty_mm) == pytest.approx((0.0, 0.4))


def test_each_distance_has_the_uncertainty_along_it_and_averaging_takes_nothing_off():
    points = [(0, 0, 0), (9, 0, 0), (0, 0, 5), (0, 7, 5)]
    commanded, *seen = measured(points, points, DEVIATIONS)
    commanded[3, 1] = 5.0
    test = distance_test(pair_rows((3, 3, 4, 4)), commanded, *seen)
    assert test.instrument_mm == pytest.approx(np.sqrt(2.0) * np.array([0.1, 0.2]))
    assert test.mean.standard_uncertainty_mm == pytest.approx(np.sqrt(2.0) * 0.15)
    assert test.largest.value_mm == pytest.approx(2.0)
    assert test.largest.standard_uncertainty_mm == pytest.approx(np.sqrt(2.0) * 0.2)


# Visits to P1 in the middle and P2 to P5 about it; commanded as in ISO 9283, order P5 to P1.
CUBE = [(-80, 80, -495), (80, 80, -495), (80, -80, -655), (-80, -80, -655), (0, 0, -575)]
VISITS = ((0.1, 0.3, 0.0), (0.3, 0.3, 0.0), (0.2, 0.2, 0.0), (0.2, 0.4, 0.0))
"""From the commanded place. Their mean is (0.2, 0.3, 0): AP = √0.13; each is 0.1 from it: l̄ = 0.1,
S = 0, RP = 0.1."""
FAR = ((0.0, 0.0, 0.3), (0.0, 0.0, -0.1), (0.0, 0.0, 0.1), (0.0, 0.0, 0.1))
"""Mean (0, 0, 0.1): AP = 0.1; distances 0.2, 0.2, 0, 0: l̄ = 0.1, S = √(0.04/3), RP = 0.1 + 3 S."""


def cube(off_mm=0.0):
    """Four cycles; encoders read `off_mm` more from cycle to cycle."""
    visits = [(cycle, place) for cycle in range(4) for place in range(5)]
    commanded = [np.add(CUBE[place], off_mm * cycle) for cycle, place in visits]
    points = [np.add(CUBE[n], (FAR if n == 3 else VISITS)[cycle]) for cycle, n in visits]
    return shots_for(ShotSet.ISO_CUBE, commanded, points)


@pytest.fixture(scope="module")
def whole():
    """Of a series with every test."""
    steps = np.arange(3.0)[:, None]
    at = np.tile(MIDDLE, (3, 1))
    turned = shots_for(ShotSet.ROTATION, at, at + 0.2 * steps * [0.0, 1.0, 0.0])
    repeated = shots_for(ShotSet.REPEATABILITY, at, at + 0.1 * steps * [1.0, 0.0, 0.0])
    lines = [*line(0), *line(1), *line(2)]
    return validated([*pairs([0.3, -0.6, 0.1]), *lines, *turned, *repeated, *cube()])


def test_every_figure_has_its_limit_and_meets_it_and_is_in_the_document(whole):
    without_limits = validation_verdict(whole, AcceptanceConfig())
    assert (without_limits.decision, without_limits.reasons) == (NO_LIMIT, ())
    verdict = validation_verdict(whole, ALL_LIMITS)
    assert (verdict.decision, verdict.reasons) == ("pass", ())
    assert limits_by_figure(ALL_LIMITS) == dict.fromkeys(whole.figures(), 1.0)
    document = whole.document()
    assert document["distances_mm"] == pytest.approx({"mean_abs": 1.0 / 3.0, "max_abs": 0.6})
    assert document["rotation_mm"] == pytest.approx(0.4)
    assert document["straightness_mm"].keys() == {"x", "y", "z"}
    assert document["repeatability"]["radius_mm"] == pytest.approx(0.1)
    assert document["repeatability"]["approaches"] == 3
    assert 0.0 < document["frame_mm"]["mean"] < document["frame_mm"]["max"] < 0.6


def test_test_that_was_not_run_is_null():
    document = validated(line(0)).document()
    assert document.pop("straightness_mm") == {"x": pytest.approx(0.0, abs=1e-9)}
    assert set(document.values()) == {None}
    assert set(validated([]).figures().values()) == {None}


def test_broken_limits_are_named_with_value_and_limit():
    result = validated([*pairs([0.3, -0.6, 0.0]), *line(1, bump_mm=(0.0, 0.0, 1.0))])
    limits = {"distance_mean_mm": 0.4, "distance_max_mm": 0.5, "straightness_mm": 0.5}
    verdict = validation_verdict(result, AcceptanceConfig(**limits))
    broken = [each for each in verdict.requirements if each.decision == "fail"]
    assert [each.name for each in broken] == ["distances, largest error", "straightness along y"]
    assert [each.error for each in broken] == pytest.approx([0.6, 0.8])
    expanded_mm = result.distances.largest.expanded_uncertainty_mm
    words = f"distances, largest error 0.600 ± {expanded_mm:.3f} mm, limit 0.5 mm: fail"
    assert words in verdict.reasons
    assert verdict.decision == "fail"
    assert decision_on(verdict, "distances, mean error") == "pass"


def test_a_limit_without_a_measurement_is_not_decided():
    verdict = validation_verdict(validated(pairs([0.3, -0.6])), ALL_LIMITS)
    assert verdict.decision == "not decided"
    assert "rotation not measured, limit 1 mm" in verdict.reasons
    nothing = validation_verdict(None, ALL_LIMITS)
    assert {each.decision for each in nothing.requirements} == {"not decided"}


@pytest.mark.parametrize(
    ("error_mm", "instrument", "decision"),
    [(-0.59, LOUD, "not decided"), (-0.59, QUIET, "pass"), (-0.61, QUIET, "fail")],
)
def test_a_limit_within_the_uncertainty_is_not_decided(error_mm, instrument, decision):
    result = validated(pairs([0.3, error_mm]), instrument)
    verdict = validation_verdict(result, AcceptanceConfig(distance_max_mm=0.6))
    assert verdict.decision == decision


def test_ap_and_rp_are_those_of_the_standard_worked_by_hand():
    result = validated([*pairs([0.0] * 8), *cube()])
    commanded = np.array([pose.commanded_mm for pose in result.cube])
    assert commanded == pytest.approx(np.array(CUBE[::-1], dtype=float))
    rp = 0.1 + 3.0 * (0.04 / 3.0) ** 0.5
    for place, pose in enumerate(result.cube):
        far = place == 1
        assert pose.accuracy.value_mm == pytest.approx(0.1 if far else 0.13**0.5)
        assert pose.rp.value_mm == pytest.approx(rp if far else 0.1)
        parts = (0.0, 0.0, 0.1) if far else (0.2, 0.3, 0.0)
        assert [part.value_mm for part in pose.components] == pytest.approx(parts, abs=1e-9)
        across_mm = 0.0 if far else (0.02 / 3.0 / 4.0) ** 0.5  # of the mean of four visits
        scatter = (across_mm, across_mm, (0.08 / 3.0 / 4.0) ** 0.5 if far else 0.0)
        for part, of_mean_mm, axis in zip(pose.components, scatter, np.eye(3), strict=True):
            by_tracker_mm = (axis @ pose.instrument_mm2 @ axis) ** 0.5
            together_mm = np.hypot(of_mean_mm, by_tracker_mm)
            assert part.standard_uncertainty_mm == pytest.approx(together_mm)
    assert [each.value_mm for each in result.worst_of_cube] == pytest.approx([0.13**0.5, rp])
    p2 = result.document()["iso9283"][1]
    assert (p2["pose"], p2["visits"], p2["rp_mm"]) == ("P2", 4, pytest.approx(rp))
    assert (p2["ap_mm"], p2["ap_z_mm"]) == pytest.approx((0.1, 0.1))


def test_ap_has_the_scatter_of_the_mean_and_the_instrument_in_its_uncertainty():
    cross = np.vstack([np.eye(3), -np.eye(3)])
    cross[:, 0] += 4.0  # along x: 5, 3 and four times 4
    accuracy = repeatability_test(*measured(cross, (0.0, 3.0, 0.0)), in_base=True).accuracy
    assert accuracy.value_mm == pytest.approx(5.0)
    seen = measured(cross, deviations=(0.3, 0.3, 0.3))
    accuracy = repeatability_test(*seen, in_base=True).accuracy
    of_mean = np.sqrt(2.0 / 5.0 / 6.0)
    assert accuracy.standard_uncertainty_mm == pytest.approx(np.hypot(of_mean, 0.3))


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_the_uncertainty_of_rp_covers_what_other_samples_scatter(axes):
    """Whether a robot scatters along one line, in a plane or in space."""
    points = np.zeros((1500, 30, 3))
    points[..., :axes] = np.random.default_rng(1).normal(size=(1500, 30, axes))
    visits = repeatability_test(*measured(points[0]), in_base=True)
    figures = [replace(visits, points_mm=sample).rp for sample in points]
    scatter = np.std([rp.value_mm for rp in figures])
    stated = np.mean([rp.standard_uncertainty_mm for rp in figures])
    assert 0.8 < scatter / stated < 1.05


def test_poses_as_encoders_read_them_are_told_apart_and_alone_fix_the_frame():
    alone = validated(cube(off_mm=0.05))
    assert [len(pose.points_mm) for pose in alone.cube] == [4] * 5
    assert cube_frame(alone) == "frame fitted to these poses alone"
    assert cube_frame(validated([*pairs([0.0] * 4), *cube()])) == "frame fitted to the pairs"
    assert len(validated(cube()[:7]).cube) == 2  # of which there are two visits


def test_limits_of_the_cube_are_judged_and_not_asked_of_others():
    limits = AcceptanceConfig(pose_accuracy_mm=0.1, pose_repeatability_mm=2.0)
    verdict = validation_verdict(validated([*pairs([0.0] * 8), *cube()]), limits)
    assert decision_on(verdict, "pose accuracy AP, worst") == "fail"
    assert decision_on(verdict, "pose repeatability RP, worst") == "pass"
    other = validated(line(0))
    names = {each.name for each in validation_verdict(other, AcceptanceConfig()).requirements}
    assert "pose accuracy AP, worst" not in names
    judged = validation_verdict(other, limits)
    assert decision_on(judged, "pose accuracy AP, worst") == "not decided"


def test_reflector_beside_the_point_may_go_where_one_turn_takes_it():
    turn, lever_mm = np.linspace(-0.3, 0.3, 5), (40.0, 0.0, -10.0)
    about_z = Rotation.from_rotvec(np.outer(turn, (0.0, 0.0, 1.0)))
    places = MIDDLE + about_z.apply(lever_mm)
    places[0, 2] += 0.05
    in_pairs = [(*row[:2], row[2] + np.array(lever_mm), row[3]) for row in pairs([0.0] * 4)]
    rows = [*in_pairs, *shots_for(ShotSet.ROTATION, [MIDDLE] * 5, places)]
    turns = np.concatenate([np.zeros(8), turn])
    assert validated(rows, turns_rad=turns, lever_mm=lever_mm).rotation.moved.value_mm == (
        pytest.approx(0.05)
    )


def test_reflector_beside_the_point_of_six_axes_may_go_where_it_is_turned_to():
    turns = np.zeros((6, 3))
    turns[:3, 0], turns[3:, 2] = (-0.2, 0.0, 0.2), (-0.3, 0.0, 0.3)
    levers = Rotation.from_rotvec(turns).apply([40.0, 0.0, -10.0])
    commanded, off = np.column_stack([MIDDLE + levers, turns]), np.zeros((6, 3))
    off[0, 1] = 0.05
    noise = PointNoise(1e-6 * np.tile(np.eye(3), (6, 1, 1)), np.zeros((6, 3, 3)))
    test = rotation_test(commanded, MIDDLE + levers + off, noise, levers)
    assert test.moved.value_mm == pytest.approx(0.05)
    assert test.about.tolist() == [0, 0, 0, 2, 0, 2]
    assert test.turn_rad.tolist() == [-0.2, 0.0, 0.2, -0.3, 0.0, 0.3]


def test_limit_of_straightness_asks_for_lines_along_which_the_robot_moves():
    rows = [*line(0), *line(1)]
    limits = AcceptanceConfig(straightness_mm=1.0)
    found = validated(rows)
    everywhere = validation_verdict(found, limits)
    assert "straightness along z" in " ".join(everywhere.reasons)
    in_plane = validation_verdict(found, limits, axes=("x", "y"))
    assert (in_plane.decision, in_plane.reasons) == ("pass", ())
