"""The goal of measuring, as it is typed."""

import pytest

from campaigns.errors import GoalInvalid
from campaigns.measuring.stopping_rule import PrecisionGoal, read_goal


@pytest.mark.parametrize("text", ["σ=0.02", "sigma=0.02", " Std = 0.02 ", "Σ=2e-2"])
def test_a_goal_is_a_standard_deviation_in_mm(text):
    assert read_goal(text) == PrecisionGoal(0.02)


def test_a_goal_reads_back_as_it_is_written():
    assert read_goal(str(PrecisionGoal(0.0125))) == PrecisionGoal(0.0125)


@pytest.mark.parametrize("text", ["", "0.02", "tau=0.02", "σ"])
def test_what_is_no_goal_is_refused_with_an_example(text):
    with pytest.raises(GoalInvalid, match="not understood") as caught:
        read_goal(text)
    assert "σ=0.02" in caught.value.remedy


@pytest.mark.parametrize("number", ["0", "-1", "nan", "inf", "11", "0,02"])
def test_a_standard_deviation_that_cannot_be_is_refused_with_the_limit(number):
    with pytest.raises(GoalInvalid, match="must be above 0 and at most 10 mm"):
        read_goal(f"σ={number}")
