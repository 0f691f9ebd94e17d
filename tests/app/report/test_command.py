"""`pkmcal report` as a command."""

import json
from pathlib import Path

import typer
from paper_campaign import PaperCampaign, new_campaign, whole_campaign
from typer.testing import CliRunner

from app.cli import report
from campaigns.settings.sections import AcceptanceConfig

DOOR = typer.Typer()
DOOR.command("report")(report.command)


def run(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(DOOR, [str(argument) for argument in arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.stdout


def test_it_writes_report_html_into_the_campaign(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "paper")
    code, said = run(paper.folder)
    assert code == 0
    assert (paper.folder / "report.html").exists()
    assert "verdict: not decided" in said


def test_json_is_one_document_on_stdout(whole: PaperCampaign, tmp_path: Path) -> None:
    code, said = run(whole.folder, "--to", tmp_path / "elsewhere.html", "--json")
    document = json.loads(said)
    assert code == 0
    assert set(document) == {"path", "decision", "reasons", "missing", "figures"}
    assert document["path"] == str(tmp_path / "elsewhere.html")
    assert len(document["figures"]) == 10


def test_a_verdict_of_fail_is_exit_code_1_and_the_report_is_written(tmp_path: Path) -> None:
    limits = AcceptanceConfig(repeatability_mm=1e-6)
    paper = whole_campaign(tmp_path / "bad", acceptance=limits)
    code, said = run(paper.folder)
    assert code == 1
    assert "verdict: fail" in said
    assert (paper.folder / "report.html").exists()


def test_where_no_limit_was_asked_for_the_command_says_so(whole: PaperCampaign, tmp_path) -> None:
    code, said = run(whole.folder, "--to", tmp_path / "elsewhere.html")
    assert code == 0
    assert "verdict: not decided (no limit asked for)" in said
