"""Patterns in errors: found where they are, and in patternless errors no oftener than p says."""

import numpy as np
import pytest

from campaigns.evaluation.patterns import (
    centred,
    neighbours_agree,
    rank_trend,
    share_from_middle,
    stands_out,
)

PLACES = np.random.default_rng(3).uniform(-300.0, 300.0, (120, 3))


def test_a_trend_is_found_whichever_way_it_bends_and_noise_has_none() -> None:
    x = PLACES[:, 0]
    assert rank_trend(x, np.exp(x / 50.0)) == (pytest.approx(1.0), pytest.approx(0.0, abs=1e-12))
    assert rank_trend(x, -x)[0] == pytest.approx(-1.0)
    assert rank_trend(x, np.random.default_rng(1).normal(size=120))[1] > 0.01
    assert rank_trend(x, np.ones(120)) == rank_trend(x[:4], x[:4]) == (0.0, 1.0)


def test_equal_values_share_their_rank() -> None:
    """By hand: ranks 1.5, 1.5, 3, 4, 5 with 1 to 5."""
    values, sizes = np.array([0.0, 0.0, 1.0, 2.0, 3.0]), np.arange(5.0)
    assert rank_trend(values, sizes)[0] == pytest.approx(0.974679, abs=1e-6)


@pytest.mark.parametrize(
    "p_of",
    [
        lambda draw: rank_trend(PLACES[:, 0], draw[:, 0])[1],
        lambda draw: neighbours_agree(PLACES, draw)[1],
        lambda draw: centred(draw[:, 0])[1],
        lambda draw: stands_out(np.linalg.norm(draw, axis=1))[1],
    ],
)
def test_p_of_patternless_errors_is_even(p_of) -> None:
    """So many of a hundred below a half, and below a tenth, as binomial scatter lets be."""
    random = np.random.default_rng(5)
    p = np.array([p_of(random.normal(size=(120, 3))) for _ in range(100)])
    assert 30 <= np.sum(p < 0.5) <= 70
    assert 1 <= np.sum(p < 0.1) <= 24


def test_neighbours_agree_on_a_field_and_not_on_noise() -> None:
    field = np.column_stack([PLACES[:, 1], -PLACES[:, 0], np.full(120, 50.0)])
    cosine, p = neighbours_agree(PLACES, field)
    assert (cosine > 0.8, p < 1e-6) == (True, True)
    assert neighbours_agree(PLACES[:3], field[:3]) == (0.0, 1.0)
    assert neighbours_agree(PLACES, np.zeros((120, 3))) == (0.0, 1.0)


def test_a_mean_beside_zero_and_a_far_error_are_found() -> None:
    errors = np.random.default_rng(2).normal(size=(60, 3))
    assert centred(errors[:, 0] + 1.0)[1] < 1e-4
    assert stands_out(np.append(np.linalg.norm(errors, axis=1), 9.0))[1] < 1e-6


def test_a_corner_is_farther_out_than_the_middle() -> None:
    places = np.vstack([PLACES, [[0.0, 0.0, 0.0]], [[300.0, 300.0, 300.0]]])
    assert share_from_middle(places, 120) == 0.0
    assert share_from_middle(places, 121) > 0.99
