"""The points behind the validation's figures, and the instrument's share in them."""

import numpy as np
import pytest
from validation_cases import MIDDLE, line, pairs, shot, validated

from campaigns.evaluation.validation import (
    distance_test,
    repeatability_test,
    rotation_test,
)
from campaigns.shots.pairs import pair_rows
from campaigns.shots.shot_sets import ShotSet

BUMP = (0.0, 0.0, 1.0)


def with_deviations(points, deviations):
    """Points whose coordinates have these standard deviations, commanded where they are."""
    points = np.array(points, dtype=float)
    commanded = np.column_stack([points, np.zeros(len(points))])
    return commanded, points, np.tile(np.diag(np.square(deviations)), (len(points), 1, 1))


def test_only_the_shots_of_the_set_are_taken() -> None:
    stray = shot(9, ShotSet.REPEATABILITY, MIDDLE)
    found = validated([*line(0), stray])
    assert len(found.line("x").points_mm) == 5
    assert found.repeatability is None, "one visit is none"


def test_the_instrument_counts_in_the_direction_of_the_error() -> None:
    sideways = with_deviations([(0, 0, 0), (0, 1, 0)], (0.1, 0.2, 0.4))
    moved = rotation_test(*sideways).moved
    assert moved.standard_uncertainty_mm == pytest.approx(np.sqrt(2.0) * 0.2)
    assert moved.expanded_uncertainty_mm == pytest.approx(2.0 * np.sqrt(2.0) * 0.2)
    along = with_deviations([(0, 0, 0), (1, 0, 0)], (0.1, 0.2, 0.4))
    assert rotation_test(*along).moved.standard_uncertainty_mm == pytest.approx(np.sqrt(2.0) * 0.1)


def test_without_an_error_the_worst_direction_counts() -> None:
    same = with_deviations([(0, 0, 0), (0, 0, 0)], (0.1, 0.2, 0.4))
    radius = repeatability_test(*same, in_base=True).radius
    assert radius.value_mm == 0.0
    assert radius.standard_uncertainty_mm == pytest.approx(0.4)


def test_each_distance_has_the_uncertainty_along_it_and_averaging_takes_nothing_off() -> None:
    points = [(0, 0, 0), (9, 0, 0), (0, 0, 5), (0, 7, 5)]
    found = distance_test(pair_rows((3, 3, 4, 4)), *with_deviations(points, (0.1, 0.2, 0.4)))
    assert found.standard_uncertainty_mm == pytest.approx(np.sqrt(2.0) * np.array([0.1, 0.2]))
    assert found.mean.standard_uncertainty_mm == pytest.approx(np.sqrt(2.0) * 0.15)


def test_the_largest_distance_error_has_the_uncertainty_of_its_own_pair() -> None:
    points = [(0, 0, 0), (9, 0, 0), (0, 0, 5), (0, 7, 5)]
    commanded, *seen = with_deviations(points, (0.1, 0.2, 0.4))
    commanded[3, 1] = 5.0
    largest = distance_test(pair_rows((3, 3, 4, 4)), commanded, *seen).largest
    assert largest.value_mm == pytest.approx(2.0)
    assert largest.standard_uncertainty_mm == pytest.approx(np.sqrt(2.0) * 0.2)


def test_distances_are_of_whole_pairs_only() -> None:
    shots = [
        shot(0, ShotSet.VALIDATION, (0, 0, -500), pair=7),
        shot(1, ShotSet.VALIDATION, (100, 0, -500), (99, 0, -500), pair=7),
        shot(2, ShotSet.VALIDATION, (50, 0, -500), pair=8),
    ]
    found = validated(shots).distances
    assert found.pairs == (7,)
    assert found.errors_mm == pytest.approx([1.0])


def test_three_points_or_a_line_fix_no_frame() -> None:
    corners = [(0, 0, -500), (100, 0, -500), (0, 100, -500), (0, 0, -600)]
    shots = [shot(k, ShotSet.VALIDATION, place) for k, place in enumerate(corners)]
    assert validated(shots).absolute_mm is not None
    assert validated(shots[:3]).absolute_mm is None


def test_repeated_visits_keep_where_they_were_commanded_and_how_far_they_are_apart() -> None:
    kind = ShotSet.REPEATABILITY
    visits = [shot(n, kind, MIDDLE, (0.3 * n, 0.0, -575.0)) for n in range(3)]
    found = validated(visits).repeatability
    assert found.commanded_mm == pytest.approx(np.array(MIDDLE))
    assert np.linalg.norm(found.away_mm, axis=1) == pytest.approx([0.3, 0.0, 0.3])
    assert found.radius.value_mm == pytest.approx(0.3)


def test_vectors_stand_in_the_base_frame_of_the_pairs() -> None:
    found = validated([*pairs([0.0, 0.0, 0.0]), *line(1, first=30, bump_mm=BUMP)])
    assert found.line("y").in_base
    assert found.line("y").away_mm[2] == pytest.approx([0.0, 0.0, 0.8], abs=1e-6)
    assert found.absolute_mm == pytest.approx(np.zeros(6), abs=1e-6)


def test_nothing_measured_gives_no_result() -> None:
    found = validated([])
    assert (found.distances, found.rotation, found.lines, found.repeatability) == (
        None,
        None,
        (),
        None,
    )
    assert found.series == {}
