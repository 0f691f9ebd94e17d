"""Whence U comes: the tracker's limits and their source, and what is refused to a certificate."""

from dataclasses import replace

import numpy as np
import pytest
from paper_campaign import PaperCampaign, new_campaign, whole_campaign
from test_certificate import WHOLE
from test_page import page, words_of

from app.console import Terminal
from app.new_campaign import create_for_devices
from app.next import tell_source_of_u
from campaigns.campaign import open_campaign
from campaigns.evidence import evaluate, gather, restated_series
from campaigns.settings.sections import AcceptanceConfig, InstrumentsConfig, PeopleConfig
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots_csv import ShotRow
from campaigns.workflow.importing import ImportTerms, import_shots

FACTS = {
    "certificate": WHOLE,
    "people": PeopleConfig(operator="A. Bee", site="Hall 3"),
    "instruments": InstrumentsConfig(robot_serial="P4-7"),
}
SMALLER = {"along_um: 10.0": "along_um: 1.0", "across_um: 15.0": "across_um: 1.0"}
SOURCE = {"data_sheet: ''": "data_sheet: Acme 3", "typed_by: ''": "typed_by: A. Bee"}


def edit(paper: PaperCampaign, changes: dict[str, str]) -> None:
    """Write other settings into campaign.yaml, as its users do."""
    path = paper.folder / "campaign.yaml"
    text = path.read_text(encoding="utf-8")
    for old, new in changes.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    paper.campaign = open_campaign(paper.folder)


def validated(folder, changes: dict[str, str], *, records: bool = True) -> PaperCampaign:
    """A campaign whose tracker states no uncertainty, by these limits."""
    paper = new_campaign(folder, **FACTS)
    edit(paper, changes)
    paper.states_uncertainty, paper.records_settings = False, records
    paper.validate("after", frozenset({ShotSet.VALIDATION, ShotSet.REPEATABILITY}))
    return paper


def expanded_mm(paper: PaperCampaign) -> float:
    return evaluate(open_campaign(paper.folder)).after.repeatability.radius.expanded_uncertainty_mm


def lacking(paper: PaperCampaign) -> str:
    return " ".join(page(paper).missing)


def test_limits_lowered_after_the_measurement_make_no_pass_and_no_certificate(pkmcal, tmp_path):
    paper = whole_campaign(
        tmp_path / "c", acceptance=AcceptanceConfig(repeatability_mm=0.03), **FACTS
    )
    paper.states_uncertainty, paper.records_settings = False, True
    paper.validate("after", frozenset({ShotSet.REPEATABILITY}))
    before, first = expanded_mm(paper), pkmcal("report", paper.folder, "--json").document
    assert first["decision"] == "not decided"
    assert any("rests on default limits" in text for text in first["missing"])
    edit(paper, SMALLER | SOURCE)
    again = pkmcal("report", paper.folder, "--json").document
    assert (again["decision"], expanded_mm(paper)) == ("not decided", before)
    text = words_of((paper.folder / "report.html").read_text(encoding="utf-8"))
    assert "<title>Calibration report" in (paper.folder / "report.html").read_text("utf-8")
    assert "along_um 10 → 1, across_um 15 → 1; the former counts" in text
    assert any("rests on default limits" in missing for missing in again["missing"])
    assert any("10 → 1" in reason for reason in again["reasons"])


def test_the_limits_that_count_stand_on_the_page_with_their_source(tmp_path):
    paper = validated(tmp_path / "c", SOURCE)
    result = page(paper)
    text = words_of(result.html)
    assert "<title>Calibration certificate" in result.html
    for words in ("10 µm + 0.3 µm/m", "15 µm + 6 µm/m", "17 ppm", "Acme 3, typed by A. Bee"):
        assert words in text
    assert "limits: data sheet" in text
    assert "part is from the tracker's limits (Acme 3, typed by A. Bee)." in text
    assert "mm (default)" in text, "the data sheet does not state what shots have in common"


def test_defaults_and_limits_without_a_record_give_no_certificate(tmp_path):
    by_default = validated(tmp_path / "a", {})
    assert "U of series 1 rests on default limits" in lacking(by_default)
    half_stated = validated(tmp_path / "b", {"data_sheet: ''": "data_sheet: Acme 3"})
    assert "rests on default limits" in lacking(half_stated), "nobody typed them"
    old = validated(tmp_path / "c", SOURCE, records=False)
    assert "whose source the journal does not record" in lacking(old)
    assert "not recorded by the software of that time" in words_of(page(old).html)


@pytest.mark.parametrize(
    ("changes", "is_named"), [(SMALLER, True), ({"along_um: 10.0": "along_um: 20.0"}, False)]
)
def test_points_imported_again_with_smaller_limits_are_named(tmp_path, changes, is_named):
    paper = new_campaign(tmp_path / "c", **FACTS)
    nominal, shots = paper.campaign.robot.kinematics, paper.plan(6, 2)[1:-1]
    joints = np.array([shot.joints for shot in shots])
    points = nominal.forward(joints).values_or_raise()[:, :3] + [3000.0, 0.0, 0.0]
    noise_mm = np.random.default_rng(3).normal(0.0, 0.01, points.shape)
    rows = [
        ShotRow(shot.pair, shot.joints, tuple(point), shot.purpose)
        for shot, point in zip(shots, (points + noise_mm).tolist(), strict=True)
    ]
    import_shots(paper.campaign, rows)
    edit(paper, changes | SOURCE)
    import_shots(paper.campaign, rows, replace(ImportTerms(), anyway=True))
    restated = list(restated_series(gather(paper.campaign)))
    assert [each[:2] for each in restated] == ([(2, 1)] if is_named else [])
    assert ("has the points of series 1, with smaller ones" in lacking(paper)) is is_named


def test_a_certificate_names_tracker_environment_and_who_authorises_it(tmp_path):
    bare = WHOLE.model_copy(update={"authorised_by": "", "robot_type": "", "conditions": ""})
    paper = new_campaign(tmp_path / "c", **FACTS | {"certificate": bare})
    lacks = lacking(paper)
    for key in (
        "certificate.authorised_by", "certificate.robot_type", "instruments.tracker",
        "tracker.serial", "certificate.conditions",
    ):  # fmt: skip
        assert f"`{key}`" in lacks


@pytest.mark.parametrize(
    ("url", "changes", "is_told"),
    [
        ("by-hand", {}, True),
        ("file:points.txt", {}, True),
        ("by-hand", SOURCE, False),
        ("tcp://127.0.0.1:700", {}, False),
    ],
)
def test_who_types_points_is_told_before_the_robot_moves(tmp_path, capsys, url, changes, is_told):
    create_for_devices(tmp_path / "c", "par4-prototype", "by-hand", url)
    paper = PaperCampaign(tmp_path / "c", open_campaign(tmp_path / "c"), np.random.default_rng(4))
    edit(paper, changes)
    tell_source_of_u(Terminal(as_json=False), paper.campaign)
    assert ("by which no certificate is issued" in capsys.readouterr().err) is is_told
