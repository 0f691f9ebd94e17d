"""The decision rule: nothing is decided that the uncertainty does not allow."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaigns.evaluation.decision import Requirement, decide, decide_all

SIZES = st.floats(0.0, 1e6, allow_nan=False)


@pytest.mark.parametrize(
    ("error", "u", "limit", "decision"),
    [
        (0.40, 0.05, 0.51, "pass"),
        (0.40, 0.05, 0.50, "pass"),  # just: |e| + U is the limit
        (0.41, 0.05, 0.50, "not decided"),
        (0.60, 0.05, 0.50, "not decided"),  # just: |e| − U is the limit, not above
        (0.61, 0.05, 0.50, "fail"),
        (-0.40, 0.05, 0.50, "pass"),
        (-0.41, 0.05, 0.50, "not decided"),
        (-0.61, 0.05, 0.50, "fail"),
        (0.50, 0.0, 0.50, "pass"),
        (0.51, 0.0, 0.50, "fail"),
        (0.0, 1.0, 0.50, "not decided"),
    ],
)
def test_a_limit_is_kept_or_broken_only_by_more_than_the_uncertainty(error, u, limit, decision):
    assert decide(error, u, limit) == decision


@given(SIZES, SIZES, SIZES, st.floats(1.0, 10.0))
def test_a_worse_instrument_never_decides_more(error, u, limit, worse):
    assert decide(error, worse * u, limit) in {decide(error, u, limit), "not decided"}


@pytest.mark.parametrize("wrong", [(math.nan, 1, 1), (1, math.inf, 1), (1, -1, 1), (1, 1, -1)])
def test_what_is_no_measurement_is_refused(wrong: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError):
        decide(*wrong)


@pytest.mark.parametrize(
    ("decisions", "together"),
    [
        ((), "not decided"),
        (("pass", "pass"), "pass"),
        (("pass", "not decided"), "not decided"),
        (("not decided", "fail", "pass"), "fail"),
    ],
)
def test_all_pass_only_when_each_does(decisions: tuple, together: str) -> None:
    assert decide_all(decisions) == together


def test_requirement_needs_a_limit_and_a_measurement() -> None:
    assert Requirement("rotation", 0.4, 0.5, 0.05).decision == "pass"
    assert Requirement("rotation", 0.4, 0.5, 0.05).expanded_uncertainty == 0.1
    assert Requirement("rotation", 0.4, None, 0.05).decision is None
    assert Requirement("rotation", None, 0.5).decision == "not decided"
    assert Requirement("rotation", None, 0.5).expanded_uncertainty is None
