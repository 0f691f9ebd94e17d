"""The terminal's table of what was gained: by the same judgement as the report's."""

import numpy as np
import pytest
from paper_campaign import PaperCampaign
from rich.cells import cell_len

from app.console import Terminal
from app.report.results_sections import GAINS
from app.report.validation_text import show_gain
from campaigns.evidence import Evaluation, evaluate
from campaigns.files.table import texts

TERMINAL_WIDTH = 80


@pytest.fixture(scope="module")
def found(whole: PaperCampaign) -> Evaluation:
    return evaluate(whole.campaign)


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
def test_a_difference_below_its_uncertainty_is_no_change_as_on_the_page(capsys, found):
    rows = rows_of(capsys, found)
    page = {row[0]: row for row in texts(GAINS, found.gains)}
    assert set(page) <= set(rows)
    for name, (_, *_, on_page) in page.items():
        assert (rows[name][3] == "no change shown") is (on_page == "no change shown"), name
    assert rows["repeatability, radius of the sphere"][3] == "no change shown"
    assert rows["distances, mean error"][3].endswith(" × less")


def test_the_uncertainty_of_each_difference_stands_beside_it(capsys, found):
    rows = rows_of(capsys, found)
    for gain in found.gains:
        expanded_mm = float(np.round(gain.expanded_uncertainty_mm, 3))
        assert float(rows[gain.name][2]) == expanded_mm
