"""`pkmcal report` as a command."""

from pathlib import Path

from paper_campaign import PaperCampaign, new_campaign

from campaigns.settings.sections import AcceptanceConfig
from campaigns.shots.shot_sets import ShotSet


def test_it_writes_report_html_into_the_campaign(pkmcal, tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "paper")
    ended = pkmcal("report", paper.folder)
    assert ended.code == 0
    assert (paper.folder / "report.html").exists()
    assert "verdict: not decided" in ended.out


def test_json_is_one_document_on_stdout(pkmcal, whole: PaperCampaign, tmp_path: Path) -> None:
    path = tmp_path / "elsewhere.html"
    said = pkmcal("report", whole.folder, "--to", path, "--json")
    assert said.code == 0
    document = said.document
    assert len(document.pop("figures")) == 11
    assert document.pop("reasons")
    assert "under acceptance" in document.pop("before_next")
    assert document.pop("next") == f"pkmcal report {whole.folder}"
    assert document == {"path": str(path), "decision": "not decided", "missing": []}
    assert "verdict: not decided (no limit asked for)" in said.err


def test_a_verdict_of_fail_is_exit_code_1_and_the_report_is_written(tmp_path: Path, pkmcal) -> None:
    paper = new_campaign(tmp_path / "bad", acceptance=AcceptanceConfig(repeatability_mm=1e-6))
    paper.validate("after", frozenset({ShotSet.REPEATABILITY}))
    ended = pkmcal("report", paper.folder)
    assert ended.code == 1
    assert "verdict: fail" in ended.out
    assert (paper.folder / "report.html").exists()
