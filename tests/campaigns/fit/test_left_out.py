"""Patterns of shots that were left out: none of random ones, a series in time, a region."""

import numpy as np
import pytest

from campaigns.fit.left_out import pattern_of

COUNT = 60


def positions(seed=1):
    return np.random.default_rng(seed).uniform(-200.0, 200.0, (COUNT, 3))


def pattern(rows, seed=1, places=None):
    kept = np.ones(COUNT, dtype=bool)
    kept[rows] = False
    places = positions(seed) if places is None else places
    return pattern_of(kept, places, np.random.default_rng(5))


@pytest.mark.parametrize("count", [2, 4, 9])
def test_random_shots_have_no_pattern(count):
    rng = np.random.default_rng(count)
    patterns = [pattern(rng.permutation(COUNT)[:count], seed) for seed in range(10)]
    assert sum(p is not None for p in patterns) <= 1


@pytest.mark.parametrize("rows", [[20, 21, 22, 23, 24], [3, 4, 5, 6, 40], [50, 51, 53, 54, 56]])
def test_shots_one_after_another_are_a_series(rows):
    assert pattern(rows) == "series"


def test_neighbours_in_space_at_any_time_are_a_region():
    places = positions()
    near = np.argsort(np.linalg.norm(places - [150.0, 150.0, 0.0], axis=1))[:6]
    assert pattern(near) == "region"


def test_pairs_that_lie_close_are_a_region_though_the_pairs_lie_apart():
    places = positions()
    for first, second in ((5, 31), (17, 44), (25, 52), (9, 39)):
        places[second] = places[first] + 1.0
    assert pattern([5, 31, 17, 44, 25, 52, 9, 39], places=places) == "region"


def test_two_shots_of_one_place_are_a_region():
    places = positions()
    places[44] = places[9] + 0.1
    assert pattern([9, 44], places=places) == "region"


def test_time_is_asked_first():
    places = positions()
    places[20:25] = places[20] + np.arange(5.0)[:, None]
    assert pattern([20, 21, 22, 23, 24], places=places) == "series"


class Draws:
    """Random orders of which the first ones begin with given rows, the others with far ones."""

    def __init__(self, rows, count):
        self._rows, self._left = rows, count

    def permutation(self, count):
        self._left -= 1
        first = self._rows if self._left >= 0 else [0, 20, 40]
        return np.r_[first, np.setdiff1d(np.arange(count), first)]


@pytest.mark.parametrize(("as_close", "expected"), [(8, "series"), (9, None)])
def test_a_pattern_is_one_that_fewer_than_one_percent_of_random_sets_have(as_close, expected):
    kept = np.ones(COUNT, dtype=bool)
    kept[[30, 31, 32]] = False
    # far apart in space, so that only time could show a pattern
    places = np.zeros((COUNT, 3))
    assert pattern_of(kept, places, Draws([30, 31, 32], as_close)) == expected


IN_ROW, LOOSE, CLOSER = [0, 12, 30, 31, 44, 57], [0, 2, 4, 7, 9, 11], [0, 2, 4, 6, 8, 10]


@pytest.mark.parametrize(
    ("rows", "drawn", "expected"),
    [
        (IN_ROW, LOOSE, "series"),
        (LOOSE, IN_ROW, None),
        (CLOSER, IN_ROW, "series"),
        (IN_ROW, CLOSER, None),
    ],
)
def test_two_in_a_row_are_closer_than_six_of_twelve_shots_and_not_than_six_of_eleven(
    rows, drawn, expected
):
    kept = np.ones(COUNT, dtype=bool)
    kept[rows] = False
    assert pattern_of(kept, np.zeros((COUNT, 3)), Draws(drawn, 999)) == expected


def test_one_shot_or_none_has_no_pattern():
    assert pattern([7]) is None
    assert pattern([]) is None


def test_two_neighbours_in_time_may_be_chance():
    # of 60 shots 59 pairs of 1770 are neighbours: 3.3 %
    assert pattern([30, 31]) is None
