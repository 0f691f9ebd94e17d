"""The comparison of real with stated errors counts what is too large, and passes that are wrong."""

from dataclasses import replace

import pytest

from benchmarks.observed_kinds import CASES, Outcome, cell_of, run_campaign

HEIGHTS = next(case for case in CASES if case.name == "37 heights")


def test_a_row_has_medians_and_counts_what_is_too_large_and_what_is_determined():
    rows = [
        Outcome(seed, "pass", {"flat": (1e-3 * real, 1e-3, float(seed > 1))}, is_wrong=False)
        for seed, real in enumerate([0.5, 0.8, 2.5])
    ]
    assert cell_of(rows, "flat") == "0.8/1 µm, 1, 1"
    assert cell_of(rows, "rotation") == ""


@pytest.mark.slow
def test_a_pass_is_wrong_if_it_does_not_determine_what_was_asked_for():
    outcome = run_campaign(HEIGHTS, 1)
    assert (outcome.verdict, outcome.is_wrong) == ("pass", False)
    real, stated, is_determined = outcome.quantities["flat"]
    assert (real < 2.0 * stated, is_determined) == (True, 1.0)
    # heights say nothing of places on the bed: a pass of these would be wrong, and there is none
    asked = run_campaign(replace(HEIGHTS, asked=("flat", "xy")), 1)
    assert (asked.verdict, asked.is_wrong) == ("not decided", False)
    assert asked.quantities["xy"][2] == 0.0
