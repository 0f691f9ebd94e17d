"""`pkmcal report` as a command."""

import json
import os
import re
import sys
from pathlib import Path

import pytest
from paper_campaign import new_campaign

from campaigns.settings.sections import AcceptanceConfig
from campaigns.shots.shot_sets import ShotSet


def test_a_verdict_of_fail_is_exit_code_1_and_the_report_is_written(tmp_path: Path, pkmcal) -> None:
    paper = new_campaign(tmp_path / "bad", acceptance=AcceptanceConfig(repeatability_mm=1e-6))
    paper.validate("after", frozenset({ShotSet.REPEATABILITY}))
    path = tmp_path / "elsewhere.html"
    ended = pkmcal("report", paper.folder, "--to", path, "--json")
    assert ended.code == 1
    assert path.exists()
    document = ended.document
    assert (document["path"], document["decision"]) == (str(path), "fail")
    assert document["figures"] == ["repeatability", "over-time"]
    assert document["reasons"]
    assert any("pkmcal run" in text for text in document["missing"])
    assert document["next"].startswith("pkmcal ")
    assert "verdict: fail\n" in ended.err
    assert f"missing: {document['missing'][0]}" in ended.err


@pytest.fixture
def browser_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """File into which the only browser on the path writes the words it was started with."""
    words, browser = tmp_path / "words.json", tmp_path / "bin" / "chromium"
    browser.parent.mkdir()
    browser.write_text(
        f"#!{sys.executable}\n"
        "import json, pathlib, sys\n"
        f"pathlib.Path({str(words)!r}).write_text(json.dumps(sys.argv[1:]))\n"
        "to = next(word for word in sys.argv if word.startswith('--print-to-pdf='))\n"
        "pathlib.Path(to.partition('=')[2]).write_bytes(b'%PDF-1.4')\n"
    )
    browser.chmod(0o755)
    monkeypatch.setenv("PATH", str(browser.parent))
    return words


@pytest.mark.parametrize(("user", "is_without_sandbox"), [(0, True), (1000, False)])
def test_a_browser_prints_and_keeps_its_sandbox_unless_root(
    pkmcal,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    browser_words: Path,
    user: int,
    is_without_sandbox: bool,
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: user)
    folder = new_campaign(tmp_path / "paper").folder
    assert pkmcal("report", folder, "--pdf").code == 0
    assert (folder / "report.pdf").read_bytes() == b"%PDF-1.4"
    words = json.loads(browser_words.read_text())
    assert ("--no-sandbox" in words) == is_without_sandbox
    assert words[-1] == (folder / "report.html").as_uri()


def test_without_a_browser_it_says_what_to_install_and_writes_nothing(
    pkmcal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    folder = new_campaign(tmp_path / "none").folder
    ended = pkmcal("report", folder, "--pdf")
    assert ended.code == 2
    assert "no browser is installed" in ended.err
    assert "install chromium" in ended.err
    assert not (folder / "report.html").exists()


def test_a_report_that_passed_or_failed_is_kept_where_the_new_one_decides_otherwise(
    tmp_path: Path, pkmcal
) -> None:
    paper = new_campaign(tmp_path / "c", acceptance=AcceptanceConfig(repeatability_mm=1e-6))
    first = pkmcal("report", paper.folder, "--json").document
    assert (first["decision"], first["former"]) == ("not decided", None)
    paper.validate("after", frozenset({ShotSet.REPEATABILITY}))
    failed = pkmcal("report", paper.folder, "--json").document
    assert failed["former"] == {
        "decision": "not decided",
        "path": str(paper.folder / "report.html"),
        "kept": None,
    }
    assert pkmcal("report", paper.folder, "--json").document["former"] is None, "the same again"
    delivered = (paper.folder / "report.html").read_bytes()
    (paper.folder / "report.pdf").write_bytes(b"%PDF")
    settings = paper.folder / "campaign.yaml"
    text = re.sub(r"(repeatability_mm:) \S*e-06", r"\1 100.0", settings.read_text())
    settings.write_text(text)
    ended = pkmcal("report", paper.folder)
    assert "report.html said fail before: kept as report-older-1.html" in ended.out
    assert (paper.folder / "report-older-1.html").read_bytes() == delivered
    assert (paper.folder / "report-older-1.pdf").exists()
