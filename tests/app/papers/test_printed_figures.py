"""The paper's figures as data."""

import math

import pytest
from par4_space import FREE_BY_DEFAULT

from app.papers.corbel2006 import printed
from app.papers.corbel2006.printed import about, above, below, exactly
from sim.scenarios.scenario import load_scenario


@pytest.mark.parametrize(
    ("figure", "low", "high"),
    [
        (exactly("5.48", ""), 5.475, 5.485),
        (exactly("0.20", ""), 0.195, 0.205),
        (exactly("7.3", ""), 7.25, 7.35),
        (exactly("96", ""), 95.5, 96.5),
        (about(10.0, ""), 9.0, 11.0),
        (below(0.01, ""), 0.0, 0.01),
        (above(20.0, ""), 20.0, math.inf),
    ],
    ids=lambda value: getattr(value, "text", None),
)
def test_words_allow_a_range_of_values(figure, low, high):
    assert figure.low == pytest.approx(low)
    assert figure.high == pytest.approx(high)


def test_range_agrees_only_when_it_meets_what_is_printed():
    figure = exactly("5.48", "")
    assert figure.allows(5.0, 5.476)
    assert figure.allows(5.484, 6.0)
    assert not figure.allows(5.0, 5.47)
    assert not figure.allows(5.49, 6.0)


@pytest.mark.parametrize(
    ("table", "scenario"),
    [(printed.TABLE_I, "paper-simulation"), (printed.TABLE_II, "paper-prototype")],
)
def test_simulated_robots_have_the_errors_of_the_tables(table, scenario):
    assert dict(load_scenario(scenario).robot.errors) == table
    assert set(table) == set(FREE_BY_DEFAULT)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_gains_follow_from_the_printed_figures(axis):
    before = float(printed.STRAIGHTNESS_BEFORE[axis].text)
    after = float(printed.STRAIGHTNESS_AFTER[axis].text)
    gain = printed.STRAIGHTNESS_GAIN[axis]
    assert gain.low - 0.1 <= 100.0 * (1.0 - after / before) <= gain.high + 0.1
