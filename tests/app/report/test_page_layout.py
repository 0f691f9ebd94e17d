"""The page as a PDF without a browser: the same words, tables, pictures and digest."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from paper_campaign import PaperCampaign, new_campaign
from test_certificate import WHOLE

from app.cli.report import report
from app.report.page_tree import page_tree
from campaigns.campaign import open_campaign
from campaigns.settings.certificate import CertificateConfig

pytestmark = pytest.mark.slow
pytest.importorskip("reportlab")
SPOKEN = ("h1", "h2", "p", "li", "dt", "dd", "th", "td", "caption", "figcaption", "text")


def text_of(pdf: Path) -> list[str]:
    """Text of each page."""
    if shutil.which("pdftotext") is None:
        pytest.skip("there is no pdftotext on this system")
    words = ["pdftotext", "-layout", str(pdf), "-"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return done.stdout.split("\f")[:-1]


def printed(paper: PaperCampaign, folder: Path) -> tuple[Path, Path]:
    from app.report.page_layout import print_without_browser

    page = report(open_campaign(paper.folder), folder / "report.html")[1]
    print_without_browser(page, page.with_suffix(".pdf"))
    return page, page.with_suffix(".pdf")


@pytest.fixture(scope="module")
def whole_pdf(whole: PaperCampaign, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return printed(whole, tmp_path_factory.mktemp("printed"))


def test_every_word_of_the_page_is_printed(whole_pdf: tuple[Path, Path]) -> None:
    page, pdf = whole_pdf
    body = next(page_tree(page.read_text()).find("body"))
    view = next(each for each in body.find("div") if each.is_a("turning"))
    nav = next(body.find("nav"))
    left_out = {*view.words.split(), *nav.words.split()}
    spoken = {word for tag in SPOKEN for each in body.find(tag) for word in each.words.split()}
    shown = re.sub(r"\s", "", "".join(text_of(pdf)))
    assert len(spoken) > 500
    assert {"budget", "combined", "(χ²", "σ"} <= spoken
    combined = {word for word in spoken if "\u0304" in word}  # an accent that is drawn by itself
    assert {word for word in spoken - left_out - combined if word not in shown} == set()


def test_every_page_names_the_record_and_its_place(
    whole_pdf: tuple[Path, Path], whole: PaperCampaign
) -> None:
    pages = text_of(whole_pdf[1])
    with whole.journal() as journal:
        digest = journal.digest()
    assert 6 <= len(pages) <= 14
    for place, text in enumerate(pages, start=1):
        assert digest[:16] in text
        assert f"{place} / {len(pages)}" in text
    assert digest in whole_pdf[1].read_bytes().decode("latin-1"), "in the document's keywords"


def test_pictures_and_the_code_have_all_their_shapes(whole_pdf: tuple[Path, Path]) -> None:
    from reportlab.graphics.shapes import Drawing

    from app.report import page_layout
    from app.report.page_tree import lines_of, shapes

    body = next(page_tree(whole_pdf[0].read_text()).find("body"))
    flat = [each for block in page_layout._blocks(body) for each in block]
    drawings = [each for each in flat if isinstance(each, Drawing)]
    pictures = [*body.find("svg")]
    assert len(drawings) == len(pictures) == 12
    for drawing, svg in zip(drawings, pictures, strict=True):
        expected = sum(len(lines_of(each)) if each.tag == "path" else 1 for each in shapes(svg))
        assert len(drawing.contents) == expected > 20


def test_the_certificate_has_a_page_of_its_own(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "c", certificate=WHOLE)
    paper.run(pairs=20, unseen=4)
    pages = text_of(printed(paper, tmp_path)[1])
    [own] = [text for text in pages if "Certificate of calibration" in text]
    for words in ("C-17", "Acme, Main Street 1", "measured by: A. Bee, date", "relate only to"):
        assert words in own
    assert "Decision, limit by limit" not in own


def test_names_with_markup_are_printed_as_text(tmp_path: Path) -> None:
    evil = "<b>&amp; <font color=red>\"'"
    paper = new_campaign(tmp_path / "evil", certificate=CertificateConfig(number=evil))
    assert evil in " ".join(text_of(printed(paper, tmp_path)[1]))


def test_without_a_browser_the_command_lays_the_page_out_itself(
    pkmcal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.report.pdf.shutil.which", lambda _name: None)
    folder = new_campaign(tmp_path / "few").folder
    ended = pkmcal("report", folder, "--pdf")
    assert ended.code == 0
    assert "report.pdf (by reportlab, plainer than a browser)" in ended.out.replace("\n", " ")
    assert (folder / "report.pdf").read_bytes().startswith(b"%PDF")


def test_with_neither_both_ways_are_told_and_nothing_is_written(
    pkmcal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.report.pdf.shutil.which", lambda _name: None)
    monkeypatch.setattr("app.report.pdf.find_spec", lambda _name: None)
    folder = new_campaign(tmp_path / "neither").folder
    ended = pkmcal("report", folder, "--pdf")
    assert ended.code == 2
    assert "pip install 'pkmcal[pdf]'" in ended.err
    assert "chromium" in ended.err
    assert not (folder / "report.html").exists()
