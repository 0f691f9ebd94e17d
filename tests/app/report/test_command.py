"""`pkmcal report` as a command."""

import json
from pathlib import Path

from paper_campaign import PaperCampaign, new_campaign

from app.main import run_command
from campaigns.settings.sections import AcceptanceConfig
from campaigns.shots.shot_sets import ShotSet


def run(*arguments: object) -> int:
    return run_command(["report", *map(str, arguments)])


def test_it_writes_report_html_into_the_campaign(tmp_path: Path, capsys) -> None:
    paper = new_campaign(tmp_path / "paper")
    assert run(paper.folder) == 0
    assert (paper.folder / "report.html").exists()
    assert "verdict: not decided" in capsys.readouterr().out


def test_json_is_one_document_on_stdout(whole: PaperCampaign, tmp_path: Path, capsys) -> None:
    path = tmp_path / "elsewhere.html"
    assert run(whole.folder, "--to", path, "--json") == 0
    said = capsys.readouterr()
    document = json.loads(said.out)
    assert len(document.pop("figures")) == 10
    assert document.pop("reasons")
    assert document == {"path": str(path), "decision": "not decided", "missing": []}
    assert "verdict: not decided (no limit asked for)" in said.err


def test_a_verdict_of_fail_is_exit_code_1_and_the_report_is_written(tmp_path: Path, capsys) -> None:
    paper = new_campaign(tmp_path / "bad", acceptance=AcceptanceConfig(repeatability_mm=1e-6))
    paper.validate("after", frozenset({ShotSet.REPEATABILITY}))
    assert run(paper.folder) == 1
    assert "verdict: fail" in capsys.readouterr().out
    assert (paper.folder / "report.html").exists()
