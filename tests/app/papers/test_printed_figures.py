"""The paper's figures as data."""

import math

import pytest
from par4_space import SPACE

from app.papers.corbel2006.printed import GROUPS, TABLE_II, allowed
from sim.scenarios.scenario import load_scenario


@pytest.mark.parametrize(
    ("words", "low", "high"),
    [
        ("5.48", 5.475, 5.485),
        ("0.20", 0.195, 0.205),
        ("7.3", 7.25, 7.35),
        ("96", 95.5, 96.5),
        ("60 (40)", 39.5, 40.5),
        ("about 10", 9.0, 11.0),
        ("< 0.01", 0.0, 0.01),
        ("≤ 0.6", 0.0, 0.6),
        ("> 20", 20.0, math.inf),
        ("5.3 to 6.6", 5.3, 6.6),
    ],
)
def test_words_allow_a_range_of_values(words, low, high):
    assert allowed(words) == pytest.approx((low, high))


def test_every_word_of_the_table_is_understood():
    words = [w for group in GROUPS for f in group.figures for w in (f.printed, f.asked) if w]
    assert len(words) == 27 + 13
    assert all(low < high for low, high in map(allowed, words))


def test_figure_that_may_differ_says_why():
    unexplained = [
        (group.experiment.name, figure.name)
        for group in GROUPS
        for figure in group.figures
        if figure.printed and not figure.reason
    ]
    assert unexplained == [
        ("simulation", "fitted pairs, before"),
        ("prototype", "radius of the sphere"),
        ("prototype", "fitted pairs, before"),
    ]


def test_prototype_has_the_errors_of_table_two():
    assert dict(load_scenario("paper-prototype").robot.errors) == TABLE_II
    assert set(TABLE_II) == set(SPACE.free_by_default)
