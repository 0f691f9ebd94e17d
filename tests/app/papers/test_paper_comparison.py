"""Ours beside the paper's: what agrees, what differs and why, what is as asked."""

import pytest
from made_up import result, results

from app.papers.corbel2006.comparison import Distribution
from app.papers.corbel2006.comparison import compare as compare_seeds
from app.papers.corbel2006.page import middle_seed
from app.papers.corbel2006.printed import BELOW_REPEATABILITY, GROUPS
from app.papers.corbel2006.quantities import QUANTITIES
from app.papers.corbel2006.trials import PROTOTYPE, SIMULATION, Errors, Trial


def compare(found, seeds=20, failed=()):
    return compare_seeds(found, seeds, failed)


def row(comparison, name, experiment=PROTOTYPE):
    return next(
        row
        for row in comparison.rows
        if row.group.experiment is experiment and row.figure.quantity == name
    )


def letters(comparison):
    """What stands under "why", by the name of the figure."""
    return {row.figure.name: comparison.letter(row) for row in comparison.rows}


def rotating_after(*values_mm):
    """Prototypes that differ in what their rotation is after calibration."""
    made = [result(PROTOTYPE, seed) for seed in range(1, len(values_mm) + 1)]
    return [
        one.model_copy(update={"after": one.after.model_copy(update={"rotation_mm": value})})
        for one, value in zip(made, values_mm, strict=True)
    ]


def test_median_and_spread_of_seeds():
    found = Distribution.of([4.0, 1.0, 2.0, 3.0, 5.0])
    assert (found.seeds, found.median) == (5, 3.0)
    assert (found.low, found.high) == pytest.approx((1.2, 4.8))
    with pytest.raises(ValueError, match="no values"):
        Distribution.of([])


def test_middle_seed_is_nearest_to_the_median():
    found = [
        result(SIMULATION, seed, fitted=Errors(before_mm=(0.0,), after_mm=(-largest_mm, 0.5)))
        for seed, largest_mm in enumerate((9.0, 1.0, 4.0, 5.0))
    ]
    assert middle_seed(found).seed == 2


def test_every_figure_of_the_table_is_computed():
    assert {figure.quantity for group in GROUPS for figure in group.figures} <= set(QUANTITIES)


def test_median_decides_what_was_asked():
    for values, passed in (((0.5, 0.59, 0.9), True), ((0.5, 0.61, 0.62), False)):
        assert row(compare(rotating_after(*values)), "rotation, after").passed is passed


def test_figure_that_differs_says_why_and_no_other():
    within = row(compare(rotating_after(0.1, 0.3)), "rotation, after")
    assert (within.agrees, within.reason) == (True, "")
    comparison = compare(rotating_after(0.5, 0.6))
    assert row(comparison, "rotation, after").reason == BELOW_REPEATABILITY
    assert BELOW_REPEATABILITY in comparison.reasons.values()
    assert row(comparison, "RP as ISO 9283 forms it").agrees is None, "nothing is printed"


def test_difference_nobody_can_explain_is_marked():
    one = result(PROTOTYPE, 1)
    odd = one.model_copy(update={"before": one.before.model_copy(update={"radius_mm": 3.0})})
    assert letters(compare([odd]))["radius of the sphere"] == "?"


def test_every_letter_in_the_tables_stands_for_a_reason():
    comparison = compare(results())
    used = {comparison.letter(row) for row in comparison.rows}
    assert used - {"", "?"} == set(comparison.reasons)
    assert list(comparison.reasons) == [chr(ord("a") + n) for n in range(len(comparison.reasons))]


def test_experiment_without_seeds_is_left_out():
    comparison = compare([result(SIMULATION, 1)])
    assert {group.experiment for group, _ in comparison.groups} == {SIMULATION}
    assert comparison.parameters == ()


def test_table_two_has_every_parameter_beside_its_estimate():
    found = {row.name: row for row in compare(results()).parameters}
    assert len(found) == 22
    assert found["arm0.joint_offset_deg"].paper == -4.04
    assert found["arm0.joint_offset_deg"].ours.median == pytest.approx(-4.04, abs=0.01)


def test_gain_is_what_has_gone_of_the_error():
    before, after = {"x": 5.0, "y": 1.0, "z": 1.0}, {"x": 1.0, "y": 1.0, "z": 1.0}
    one = result(PROTOTYPE, 1)
    one = one.model_copy(
        update={
            "before": one.before.model_copy(update={"straightness_mm": before}),
            "after": one.after.model_copy(update={"straightness_mm": after}),
        }
    )
    assert row(compare([one]), "along x, gain").ours.median == pytest.approx(80.0)


def test_missed_median_fails_and_says_by_how_much_and_why():
    comparison = compare([*results(1)[:2], *rotating_after(0.75)])
    (line,) = comparison.lines
    assert line.startswith("missed: Section IV.E.3: ")
    assert "rotation, after 0.75, asked ≤ 0.6; why:" in line
    assert comparison.decision == "fail"
    assert comparison.headline == "12 of 13 medians are as asked."


def test_failed_seeds_are_named_together_and_spoil_the_verdict():
    found = compare(results(), failed=[(Trial(PROTOTYPE, seed), "no beam") for seed in (4, 2)])
    assert found.decision == "fail"
    assert found.lines == ("failed: prototype, seed 2, 4: no beam",)


def test_verdict_passes_when_all_medians_are_as_asked_and_few_seeds_are_called_a_look():
    found = compare(results())
    assert (found.decision, found.lines) == ("pass", ())
    assert found.headline == "13 of 13 medians are as asked."
    (line,) = compare(results(), 3).lines
    assert line.startswith("3 seeds of each are a look")
    assert compare([]).decision == "fail", "nothing compared is no pass"
