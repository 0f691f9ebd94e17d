"""The page in a real browser: nothing cut, nothing missing, nothing complained of."""

import json
import re
import shutil
import subprocess
from importlib.resources import files
from pathlib import Path

import pytest
from browser import Browser, find_browser
from paper_campaign import PaperCampaign, new_campaign
from test_page import FIGURES

from app.cli.report import report
from campaigns.campaign import open_campaign
from campaigns.settings.sections import PeopleConfig

pytestmark = [pytest.mark.peer, pytest.mark.timeout(240)]

TABLET = 800
A4_PT = (595.0, 842.0)
WHOLE_WIDTH = "document.documentElement.scrollWidth"
CUT = """[...document.querySelectorAll('h1,h2,p,li,dt,dd,caption,th,td,figcaption')]
    .filter(e => e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display != 'inline')
    .map(e => e.textContent)"""
OUTSIDE = """[...document.querySelectorAll('body *')].filter(e => {
    const r = e.getBoundingClientRect();
    return r.width > 0 && (r.right > innerWidth + 1 || r.left < -1);
}).map(e => e.tagName + ' ' + e.textContent.slice(0, 40))"""
BROKEN = """[...document.querySelectorAll("td.words")].filter(e => {
    const all = document.createRange();
    all.selectNodeContents(e);
    const lines = new Set([...all.getClientRects()].map(r => Math.round(r.top)));
    return e.textContent.trim().length <= 24 && lines.size > 1;
}).map(e => e.textContent)"""
DRAWN = """Object.fromEntries([...document.querySelectorAll('figure')].map(f => [f.id, [
    f.querySelector('svg').getBoundingClientRect().width,
    f.querySelectorAll('svg text').length,
    f.querySelectorAll('svg :is(path, polyline, polygon, circle, rect, use)').length]]))"""


@pytest.fixture(scope="module")
def browser() -> Browser:
    found = find_browser()
    if found is None:
        pytest.skip("there is no Chromium on this system")
    return found


@pytest.fixture(scope="module")
def page(whole: PaperCampaign, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return report(whole.campaign, tmp_path_factory.mktemp("pages") / "report.html")[1]


@pytest.fixture(scope="module")
def pdf(browser: Browser, page: Path) -> Path:
    browser.print_pdf(page, page.with_suffix(".pdf"))
    return page.with_suffix(".pdf")


@pytest.fixture(scope="module")
def pdf_pages(pdf: Path) -> list[str]:
    """The text of each printed page."""
    if shutil.which("pdftotext") is None:
        pytest.skip("there is no pdftotext on this system")
    words = ["pdftotext", "-layout", str(pdf), "-"]
    text = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    return text.split("\f")[:-1]


def test_figures_are_drawn_large_enough_with_text_and_no_complaint(
    browser: Browser, page: Path
) -> None:
    assert browser.console(page) == []
    drawn = browser.measure(page, TABLET, DRAWN)
    assert set(drawn) == FIGURES
    for name, (width, texts, shapes) in drawn.items():
        assert width > 300, name
        assert texts > 5, name
        assert shapes > 20, name


def test_no_text_is_cut_and_no_short_word_of_a_table_is_broken(
    browser: Browser, page: Path
) -> None:
    for width in (TABLET, 1200):
        whole, *faults = browser.measure(page, width, f"[{WHOLE_WIDTH}, {CUT}, {OUTSIDE}]")
        assert whole <= width
        assert faults == [[], []]
    for width in (390, TABLET):
        whole, broken = browser.measure(page, width, f"[{WHOLE_WIDTH}, {BROKEN}]")
        assert whole <= max(width, 500), "a browser's window is no narrower"
        assert broken == []


def test_long_names_are_broken_not_cut(browser: Browser, tmp_path: Path) -> None:
    people = PeopleConfig(operator="Wolfeschlegelsteinhausen" * 8, site="/" * 200)
    paper = new_campaign(tmp_path / "long", people=people)
    robot = paper.folder / "robot.yaml"
    robot.write_text(robot.read_text().replace("name: par4-prototype", f"name: {'r' * 150}"))
    _, path, _ = report(open_campaign(paper.folder))
    found = browser.measure(path, TABLET, f"[{WHOLE_WIDTH}, {CUT}]")
    assert found[0] <= TABLET
    assert found[1] == []


def test_the_print_is_on_a4(pdf: Path) -> None:
    boxes = re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", pdf.read_bytes())
    assert 5 <= len(boxes) <= 14
    for box in boxes:
        assert tuple(map(float, box)) == pytest.approx(A4_PT, abs=1.0)


def test_every_printed_page_names_the_record_and_its_place(
    pdf_pages: list[str], whole: PaperCampaign
) -> None:
    with whole.journal() as journal:
        digest = journal.digest()[:16]
    for place, text in enumerate(pdf_pages, start=1):
        assert digest in text
        assert f"{place} / {len(pdf_pages)}" in text


def test_no_table_and_no_figure_is_cut_by_a_page(pdf_pages: list[str]) -> None:
    for first, last in (
        ("Specified limits", "repeatability, radius of the sphere"),
        ("Errors of distance and position", "commanded positions"),
        ("Uncertainty budget of positions", "combined"),
        ("ISO 9283, before and after calibration", "repeatability RP"),
        ("pairs, in the order of the plan", "Errors of distance, pair by pair."),
        ("since the series' first shot", "Air and drift while measuring."),
    ):
        pages = [text for text in pdf_pages if first in text]
        assert len(pages) == 1, first
        assert last in pages[0], first


def test_the_live_page_fits_a_phone_and_shows_injected_names_as_text(
    browser: Browser, tmp_path: Path
) -> None:
    evil = "<img src=x onerror=document.title='owned'>" * 3
    state = {
        "name": evil,
        "colour": "red",
        "state": "the beam is broken",
        "detail": "lost " * 20,
        "done": 1234,
        "total": 10000,
        "events": [{"at_utc": "2026-03-02T08:00:00+00:00", "text": evil}],
        "latest_utc": "2026-03-02T08:00:00+00:00",
        "next": "pkmcal run " + "very-long-folder-name" * 5,
    }
    text = files("app.monitor").joinpath("live.html").read_text(encoding="utf-8")
    live = tmp_path / "live.html"
    shown = json.dumps(state).replace("<", "\\u003c")
    live.write_text(text.replace("\nlook();", f"\nshow({shown});"), encoding="utf-8")
    for width in (390, 1280):
        assert browser.measure(live, width, WHOLE_WIDTH) <= max(width, 500)
        assert browser.measure(live, width, OUTSIDE) == []
    images, title = browser.measure(live, 390, "[document.images.length, document.title]")
    assert (images, title) == (0, f"1234/10000 {evil}")
