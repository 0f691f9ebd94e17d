"""The page: whole, self-contained, escaped; it shows what there is."""

import re
from html import unescape

import pytest
from made_up import result, results

from app.papers.corbel2006.comparison import compare
from app.papers.corbel2006.page import page_html
from app.papers.corbel2006.trials import PROTOTYPE, SIMULATION, Trial

MADE = "2026-03-02T08:15:00.000+00:00"
FIGURES = ["every-seed", "fig-7", "parameters-missed", "fig-8", "noise-alone", "errors-and-lengths"]
NOT_LOADED = ("http://www.w3.org/", "data:")
"""Names of XML's, and what a page holds itself."""


def made(found, computed, failures=()):
    return page_html(found, compare(found, 20, failures), computed, MADE)


@pytest.fixture(scope="module")
def html(computed):
    return made(results(), computed)


def test_page_has_every_figure_and_needs_no_network(html):
    assert re.findall(r'<figure\b[^>]* id="([^"]+)"', html) == FIGURES
    loaded = re.findall(r'(?:src|href|xlink:href)="([^"#][^"]*)"|url\(([^#)][^)]*)\)', html)
    addresses = [address for pair in loaded for address in pair if address]
    assert all(address.startswith(NOT_LOADED) for address in addresses)
    assert "<script" not in html
    ids = re.findall(r'\bid="([^"]+)"', html)
    assert len(ids) == len(set(ids))
    assert len(html.encode()) < 1_000_000, "small enough to send"


def test_reason_of_a_failure_is_text(computed):
    failed = [(Trial(SIMULATION, 4), "<script>alert(1)</script>")]
    html = made([], computed, failed)
    assert "<script>" not in html
    assert "failed: simulation, seed 4: &lt;script&gt;" in html
    assert ">Fail<" in html


def test_figures_are_set_beside_the_paper(html):
    text = re.sub(r"<[^>]+>", " ", html)
    assert re.search(r"along x, before\s+5\.48\s+5\.60", text)
    assert re.search(r"arm0\.joint_offset_deg\s+−4\.04\s+−4\.04", text)
    assert "2026-03-02 08:15 UTC" in text


def test_page_says_in_words_what_the_evidence_says(html):
    text = " ".join(unescape(re.sub(r"<[^>]+>", " ", html)).split())
    assert "reaches 9 points of the grid" in text
    assert "at most 50, 0, 50 mm anywhere; the tests of section IV.E need 800, 800, 500 mm" in text
    assert re.search(r"off by \d+\.\d % of itself on average", text)
    assert re.search(r"The paper's 7\.3 and 15\.2 mm belong to pairs of about \d+ and \d+ mm", text)


@pytest.mark.parametrize(
    ("experiment", "missing"),
    [(SIMULATION, {"every-seed", "fig-8", "noise-alone"}), (PROTOTYPE, {"fig-7"})],
)
def test_page_of_one_experiment_shows_what_there_is(experiment, missing, computed, monkeypatch):
    monkeypatch.setattr("app.report.rendering.drawn", lambda *_: "")
    html = made([result(experiment, 1)], computed)
    assert set(FIGURES) - set(re.findall(r'<figure\b[^>]* id="([^"]+)"', html)) == missing
