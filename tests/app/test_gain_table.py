"""The terminal's table of what was gained: by the same judgement as the report's."""

from contextlib import nullcontext
from dataclasses import replace

import pytest
from paper_campaign import PaperCampaign
from rich.cells import cell_len
from typer import Exit

from app.console import Terminal
from app.report.tables import GAINS, change
from app.report.terminal_text import show_gain, show_validation
from campaigns.assessment import Evaluation, evaluate
from campaigns.evaluation.measured_lengths import MeasuredLength
from campaigns.evaluation.verdict import Gain
from campaigns.files.table import texts
from campaigns.workflow.validation import Validated

TERMINAL_WIDTH = 80


def rows_of(capsys, found: Evaluation) -> dict[str, list[str]]:
    """Cells by their row's name."""
    show_gain(Terminal(as_json=False), found)
    lines = capsys.readouterr().out.splitlines()
    assert all(cell_len(line) <= TERMINAL_WIDTH for line in lines)
    rows: dict[str, list[str]] = {}
    for line in lines:
        cells = [cell.strip() for cell in line.split("  ") if cell.strip()]
        if len(cells) > 1:
            rows[cells[0]] = cells[1:]
    return rows


@pytest.mark.slow
def test_a_difference_below_its_uncertainty_is_no_change_as_on_the_page(capsys, evaluation):
    rows = rows_of(capsys, evaluation)
    page = {row[0]: row for row in texts(GAINS, evaluation.gains)}
    assert set(page) <= set(rows)
    for name, (*_, on_page, _) in page.items():
        assert (rows[name][2] == "no change shown") is (on_page == "no change shown"), name
    assert rows["repeatability, radius of the sphere"][2] == "no change shown"
    assert rows["distances, mean error"][2].endswith(" × less")


@pytest.mark.parametrize("stage", ["before", "after"])
def test_limits_are_held_against_the_calibrated_robot_alone(capsys, whole: PaperCampaign, stage):
    config = whole.campaign.config
    limits = config.acceptance.model_copy(update={"distance_mean_mm": 1e-6})
    campaign = replace(whole.campaign, config=config.model_copy(update={"acceptance": limits}))
    found = evaluate(campaign)
    result = found.before if stage == "before" else found.after
    assert result is not None
    ends = pytest.raises(Exit) if stage == "after" else nullcontext()  # exit code 1, or 0
    with ends:
        show_validation(Terminal(as_json=False), Validated(stage, result, found), campaign)
    said = capsys.readouterr().out
    stated = "before calibration, errors are only stated; 1 of the limits"
    assert said.startswith(stated if stage == "before" else "verdict: not decided\n")
    assert ("not good: distances, mean" in said) is (stage == "after")


def test_a_factor_has_two_digits_and_below_its_uncertainty_only_a_bound():
    before = MeasuredLength(18.153, 0.0)
    assert change(Gain("", before, MeasuredLength(0.119, 0.005))) == "150 × less"
    assert change(Gain("", before, MeasuredLength(0.016, 0.025))) == "> 270 × less"
