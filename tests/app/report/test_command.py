"""`pkmcal report` as a command."""

import csv
import json
import os
import re
import sys
from pathlib import Path

import pytest
from paper_campaign import PaperCampaign, new_campaign

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


@pytest.mark.parametrize("is_there", [True, False])
def test_open_shows_the_page_and_says_where_no_browser_is(
    pkmcal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_there: bool
) -> None:
    folder, opened = new_campaign(tmp_path / "paper").folder, list[str]()
    monkeypatch.setattr("webbrowser.open", lambda uri: opened.append(uri) or is_there)
    ended = pkmcal("report", folder, "--open")
    assert opened == [(folder / "report.html").as_uri()]
    assert f"Open {opened[0]}" in ended.out
    assert ("no browser opens it here" in ended.err) is not is_there


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
    pkmcal("report", paper.folder, "--csv")
    figures = (paper.folder / "report.csv").read_bytes()
    settings = paper.folder / "campaign.yaml"
    text = re.sub(r"(repeatability_mm:) \S*e-06", r"\1 100.0", settings.read_text())
    settings.write_text(text)
    ended = pkmcal("report", paper.folder)
    assert "report.html said fail before: kept as report-older-1.html" in ended.out
    assert (paper.folder / "report-older-1.html").read_bytes() == delivered
    assert (paper.folder / "report-older-1.pdf").exists()
    assert (paper.folder / "report-older-1.csv").read_bytes() == figures


@pytest.fixture(scope="module")
def identified(whole: PaperCampaign, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a campaign with validations and limits, of which one is met and one is not set."""
    acceptance = AcceptanceConfig(distance_mean_mm=12.5, repeatability_mm=1e-6)
    return whole.copy_to(tmp_path_factory.mktemp("values") / "c", acceptance=acceptance).folder


def rows_of(text: str, mark: str = ",") -> list[dict[str, str]]:
    """Rows of a CSV file by heading."""
    return [*csv.DictReader(text.splitlines(), delimiter=mark)]


@pytest.mark.usefixtures("undrawn")
def test_figures_of_the_page_are_rows_of_a_csv_file_and_values_of_the_document(
    pkmcal, identified: Path
) -> None:
    ended = pkmcal("report", identified, "--csv", "--json")
    path = identified / "report.csv"
    assert f"written: {path}" in ended.err
    rows, values = rows_of(path.read_text(encoding="utf-8")), ended.document["values"]
    assert {row.pop("campaign") for row in rows} == {"paper"}
    as_text = [{key: "" if of is None else str(of) for key, of in row.items()} for row in values]
    assert [row["name"] for row in rows] == [row["name"] for row in values]
    for row, value in zip(rows, as_text, strict=True):
        numbers = {key for key, text in row.items() if text and key not in WORDS}
        assert {key: float(row[key]) for key in numbers} == {
            key: float(value[key]) for key in value if value[key] and key not in WORDS
        }
        assert {key: row[key] for key in WORDS} == {key: value[key] for key in WORDS}
    by_name = {(row["table"], row["name"], row["stage"]): row for row in values}
    assert by_name["verdict", "campaign", ""]["decision"] == "fail"
    mean = by_name["limits", "distances_mean_error", "after"]
    assert (mean["limit"], mean["decision"], mean["unit"]) == (12.5, "pass", "mm")
    assert mean["value"] + mean["expanded_uncertainty"] <= 12.5
    assert by_name["limits", "repeatability_radius_of_the_sphere", "after"]["decision"] == "fail"
    assert by_name["limits", "rotation", "after"]["decision"] is None
    of_stage = by_name["stages", "distances_mean_error", "after"]
    assert of_stage["expanded_uncertainty"] == pytest.approx(mean["expanded_uncertainty"])
    before = by_name["stages", "distances_mean_error", "before"]["value"]
    change = by_name["stages", "distances_mean_error", "change"]
    assert change["value"] == pytest.approx(mean["value"] - before)
    assert 0.0 < change["expanded_uncertainty"] < 1.0
    shares = [row["std"] for row in values if row["table"] == "budget" and row["type"]]
    combined = by_name["budget", "combined", ""]["std"]
    assert combined == pytest.approx(sum(share**2 for share in shares) ** 0.5)
    offset = by_name["parameters", "arm2.joint_offset_deg", ""]
    assert offset["unit"] == "deg"
    assert offset["value"] - offset["nominal"] == pytest.approx(0.4, abs=4.0 * offset["std"])
    assert not any(" " in row["name"] for row in values)


WORDS = ("table", "name", "stage", "unit", "decision", "type")
"""Columns of the figures that are no numbers."""


@pytest.mark.usefixtures("undrawn")
def test_figures_for_spreadsheets_have_semicolons_and_decimal_commas(
    pkmcal, identified: Path
) -> None:
    page, table = identified / "other.html", identified / "other.csv"
    assert "written" in pkmcal("report", identified, "--to", page, "--csv", "--excel").out
    assert table.read_bytes().startswith(b"\xef\xbb\xbfcampaign;table;name;")
    (mean,) = [
        row
        for row in rows_of(table.read_text(encoding="utf-8-sig"), ";")
        if (row["table"], row["name"]) == ("limits", "distances_mean_error")
    ]
    assert mean["limit"] == "12,5"
    assert pkmcal("report", identified, "--to", page, "--csv").code == 1, "ours is replaced"
    assert table.read_text(encoding="utf-8").startswith("campaign,table,")


def test_no_other_file_is_replaced_by_figures(pkmcal, tmp_path: Path) -> None:
    folder = new_campaign(tmp_path / "c").folder
    plan = folder / "plan.csv"
    plan.write_text("shot,set\n")
    refused = pkmcal("report", folder, "--to", folder / "plan.html", "--csv")
    assert refused.code == 2
    assert "has no figures of a report" in refused.error_line
    assert plan.read_text() == "shot,set\n"
    assert not (folder / "plan.html").exists()
    refused = pkmcal("report", folder, "--to", folder / "new.csv", "--csv")
    assert "end in .html" in refused.error_line
    assert "add --csv" in pkmcal("report", folder, "--excel").error_line
