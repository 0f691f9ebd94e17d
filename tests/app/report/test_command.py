"""`pkmcal report` as a command."""

import json
from pathlib import Path

import typer
from paper_campaign import PaperCampaign, new_campaign
from typer.testing import CliRunner

from app.cli import report

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
