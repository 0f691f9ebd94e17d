"""The decision rule: nothing is decided that the uncertainty does not allow."""

import ast
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import campaigns
from campaigns.evaluation.decision import (
    Requirement,
    allows_decision,
    chance_of_larger,
    coverage_factor,
    decide,
    decide_all,
    decide_change,
    effective_dof,
)

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


def test_the_margin_is_what_is_left_of_the_limit_and_negative_beyond_it() -> None:
    assert Requirement("rotation", -0.4, 0.5, 0.05).margin == pytest.approx(0.1)
    assert Requirement("rotation", 0.7, 0.5).margin == pytest.approx(-0.2)
    assert Requirement("rotation", 0.7, None).margin is None
    assert Requirement("rotation", None, 0.5).margin is None


def test_a_requirement_says_its_figure_its_limit_and_what_was_decided() -> None:
    figure = Requirement("rotation", 0.4, 0.5, 0.05)
    assert figure.in_words() == "rotation 0.400 ± 0.100 mm, limit 0.5 mm: pass"
    figure = Requirement("rotation", -0.4, 0.1, 0.05)
    assert figure.in_words("°") == "rotation -0.400 ± 0.100 °, limit 0.1 °: fail"
    assert Requirement("rotation", None, 0.5).in_words() == "rotation not measured, limit 0.5 mm"
    assert Requirement("rotation", None, None).in_words() == "rotation not measured"


def test_coverage_grows_with_few_repeats_and_with_the_number_of_errors() -> None:
    assert coverage_factor() == 2.0
    assert coverage_factor(1e9) == pytest.approx(2.0)
    assert coverage_factor(4) == pytest.approx(2.87, abs=0.01)  # GUM, table G.2, for 95.45 %
    assert coverage_factor(1) == pytest.approx(13.97, abs=0.01)  # the fewest that there may be
    assert coverage_factor(10) == pytest.approx(2.28, abs=0.01)
    assert coverage_factor(count=20) == pytest.approx(3.05, abs=0.01)
    assert decide(0.4, 0.05, 0.5) == "pass"
    assert decide(0.4, 0.05, 0.5, dof=4) == decide(0.4, 0.05, 0.5, count=20) == "not decided"
    assert Requirement("", 0.4, 0.5, 0.05, count=20).decision == "not decided"
    for wrong in ((0.5, 1), (math.nan, 1), (math.inf, 0)):
        with pytest.raises(ValueError):
            coverage_factor(*wrong)


def test_a_difference_counts_only_beyond_its_uncertainty() -> None:
    assert decide_change(0.101, 0.05) == "larger"
    assert decide_change(-0.101, 0.05) == "smaller"
    assert decide_change(0.099, 0.05) == decide_change(-0.099, 0.05) == "no change shown"
    assert decide_change(0.101, 0.05, dof=10) == "no change shown"


def test_a_scatter_estimated_from_few_shots_raises_no_more_alarms_than_stated() -> None:
    """20 pairs over a scatter of 20 degrees of freedom: χ² raises more than five times as many."""
    rng, level = np.random.default_rng(3), 0.01
    variance = rng.chisquare(20, 4000) / 20
    chi2 = (rng.normal(size=(4000, 20)) ** 2).sum(axis=1) / variance
    by_f = np.mean([chance_of_larger(value, 20, 20) < level for value in chi2])
    by_chi2 = np.mean([chance_of_larger(value, 20) < level for value in chi2])
    assert by_f == pytest.approx(level, abs=0.005)
    assert by_chi2 > 5 * level
    assert effective_dof(2.0, 1.0, 20) == 80.0  # half of the variance is known
    assert effective_dof(3.0, 1.0, 20) == 180.0
    assert effective_dof(1.0 - 1e-9, 1.0, 20) == 20.0
    assert math.isinf(effective_dof(1.0, 0.0, 20))


def test_positions_known_worse_than_the_limit_or_the_error_before_decide_nothing() -> None:
    limits = {"mean": 0.3, "max": 0.8}
    assert allows_decision(0.149, limits, None) is None
    too_large = "U of distances is 0.302 mm (k = 2), more than the limit of the mean error, 0.3 mm"
    assert allows_decision(0.151, limits, None) == too_large
    assert "error before, 1.5 mm" in (allows_decision(4.9, {}, 1.5) or "")
    assert allows_decision(0.74, {}, 1.5) is None
    assert allows_decision(4.9, {"mean": 20.0}, 1.5) is None  # limits decide where there are any
    assert allows_decision(4.9, {}, None) is None
    assert allows_decision(math.nan, {}, 1.5) == "σ of positions is unknown"


CAMPAIGNS = Path(campaigns.__file__).parent
JUDGING = [
    *sorted((CAMPAIGNS / "evaluation").glob("*.py")),
    *sorted((CAMPAIGNS / "controllers").glob("*.py")),
    *map(CAMPAIGNS.joinpath, ("assessment.py", "chain.py", "evidence.py")),
    *map(CAMPAIGNS.joinpath, ("workflow/loading.py", "workflow/validation.py")),
]
# the rule itself; mistaken files, not results
ELSEWHERE = {"decision.py", "plausibility.py", "pieces.py"}
FIGURE = re.compile(r"limit|(value|before|after|error|upper|lost)_mm$|^error$|_abs$|^rms$")
ORDER = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)


def compared_figures(source: str) -> list[str]:
    """Comparisons by size of something that is named as a measured figure or as a limit."""
    return [
        ast.unparse(node)
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Compare) and any(isinstance(op, ORDER) for op in node.ops)
        for side in (node.left, *node.comparators)
        if FIGURE.search(ast.unparse(side).split(".")[-1])
    ]


def test_no_measured_figure_is_compared_outside_of_the_decision_rule() -> None:
    for path in JUDGING:
        if path.name not in ELSEWHERE:
            assert compared_figures(path.read_text("utf-8")) == [], path
    assert compared_figures("if gain.after.value_mm > before_mm: pass")
    assert compared_figures("all(x[name] <= limit for name, limit in pairs)")
    assert not compared_figures("if len(rows) >= SHOTS_OF_A_LINE: pass")
