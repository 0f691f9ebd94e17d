"""Whence U comes: the tracker's limits and their source, and what is refused to a certificate."""

from dataclasses import replace

import numpy as np
import pytest
from paper_campaign import (
    NOISE_MM,
    TRACKER_FROM_BASE,
    TRUE,
    PaperCampaign,
    new_campaign,
    validation_shots,
)
from test_certificate import WHOLE
from test_page import page, words_of, words_on

from app.console import Terminal
from app.new_campaign import create_for_devices
from app.next import tell_source_of_u
from app.report.record import facts
from campaigns.assessment import evaluate
from campaigns.campaign import open_campaign
from campaigns.chain import sources_of
from campaigns.evidence import gather
from campaigns.robots.robot import pose_row
from campaigns.settings.config import changed_settings
from campaigns.settings.sections import AcceptanceConfig, InstrumentsConfig, PeopleConfig
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots_csv import ShotRow
from campaigns.workflow.importing import ImportTerms, declared_set, import_shots, import_validation
from campaigns.workflow.validation import Validated
from drivers.texts import moment

pytestmark = pytest.mark.usefixtures("undrawn")
FACTS = {
    "certificate": WHOLE,
    "people": PeopleConfig(operator="A. Bee", site="Hall 3"),
    "instruments": InstrumentsConfig(robot_serial="P4-7"),
}
SMALLER = {"tracker.uncertainty.along_um": "1", "tracker.uncertainty.across_um": "1"}
SOURCE = {
    "tracker.uncertainty.data_sheet": "Acme 3",
    "tracker.uncertainty.typed_by": "A. Bee",
    "tracker.common.data_sheet": "Acme 4",
    "tracker.common.typed_by": "C. Dee",
}
CERTIFICATE = "<title>Calibration certificate"


def edit(paper: PaperCampaign, changes: dict[str, str]) -> None:
    """Write other settings into campaign.yaml, as its users do."""
    text = changed_settings(paper.folder, changes).text
    (paper.folder / "campaign.yaml").write_text(text, encoding="utf-8")
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


def test_limits_lowered_after_the_measurement_make_no_pass_and_no_certificate(
    pkmcal, whole, tmp_path
):
    limits = AcceptanceConfig(repeatability_mm=0.03)
    paper = whole.copy_to(tmp_path / "c", acceptance=limits, **FACTS)
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
    assert CERTIFICATE in result.html
    for words in ("10 µm + 0.3 µm/m", "15 µm + 6 µm/m", "17 ppm", "Acme 3, typed by A. Bee"):
        assert words in text
    assert "limits: data sheet" in text
    assert "part is from the tracker's limits (Acme 3, typed by A. Bee)." in text
    assert "Acme 4, typed by C. Dee" in text, "what all shots have in common has its own source"


def test_defaults_and_limits_without_a_record_give_no_certificate(tmp_path):
    by_default = validated(tmp_path / "a", {})
    assert "U of series 1 rests on default limits (state `tracker.unc" in lacking(by_default)
    edit(by_default, SOURCE)
    by_default.validate("after", frozenset({ShotSet.VALIDATION, ShotSet.REPEATABILITY}))
    assert "rests on default limits" not in lacking(by_default), "it is measured anew"
    half_stated = validated(tmp_path / "b", {"tracker.uncertainty.data_sheet": "Acme 3"})
    assert "rests on default limits" in lacking(half_stated), "nobody typed them"
    old = validated(tmp_path / "c", SOURCE, records=False)
    assert "whose source the journal does not record" in lacking(old)
    assert "not recorded by the software of that time" in words_of(page(old).html)


def test_what_all_shots_have_in_common_needs_a_source_whatever_points_state(tmp_path):
    paper = new_campaign(tmp_path / "c", **FACTS)
    paper.records_settings = True
    paper.validate("after", frozenset({ShotSet.REPEATABILITY}))
    assert "U of series 1 rests on default limits (state `tracker.common`" in lacking(paper)
    assert "`tracker.uncertainty`" not in lacking(paper), "each point states its own"
    edit(paper, SOURCE)
    assert "`tracker.common`" in lacking(paper), "the record counts, not what is typed later"


def imported_rows(paper: PaperCampaign) -> list[ShotRow]:
    """Shots of a plan as other software has them, without an uncertainty."""
    nominal, shots = paper.campaign.robot.kinematics, paper.plan(6, 2)[1:-1]
    joints = np.array([shot.joints for shot in shots])
    points = nominal.forward(joints).values_or_raise()[:, :3] + [3000.0, 0.0, 0.0]
    noise_mm = np.random.default_rng(3).normal(0.0, 0.01, points.shape)
    return [
        ShotRow(shot.pair, shot.joints, tuple(point), shot.purpose)
        for shot, point in zip(shots, (points + noise_mm).tolist(), strict=True)
    ]


def stating(rows: list[ShotRow], std_mm: float) -> list[ShotRow]:
    """The rows, each with an uncertainty of its own."""
    variance = std_mm**2
    own = tuple(tuple(variance * (row == column) for column in range(3)) for row in range(3))
    return [replace(row, covariance_mm2=own) for row in rows]


@pytest.mark.parametrize(
    ("changes", "own_mm", "says"),
    [
        (SMALLER, None, "0.0202 → 0.0121 mm"),
        ({"tracker.uncertainty.along_um": "20"}, None, ""),
        ({}, 0.001, "0.0202 → 0.0010 mm"),
        ({}, 0.1, ""),
        ({"tracker.common.scale_ppm": "1"}, None, "scale_ppm 17 → 1"),
    ],
)
def test_points_imported_again_with_less_uncertainty_pass_nothing(tmp_path, changes, own_mm, says):
    paper = new_campaign(tmp_path / "c", **FACTS)
    rows = imported_rows(paper)
    import_shots(paper.campaign, rows)
    edit(paper, changes | SOURCE)
    again = rows if own_mm is None else stating(rows, own_mm)
    import_shots(paper.campaign, again, replace(ImportTerms(), anyway=True))
    restated = [
        check for check in evaluate(paper.campaign).checks if "stated of" in check.statement
    ]
    assert bool(restated) is bool(says)
    assert all(check.decides and not check.holds for check in restated)
    for check in restated:
        assert says in check.detail
        reason = next(r for r in evaluate(paper.campaign).verdict.reasons if says in r)
        began = [series.started_utc for series in evaluate(paper.campaign).evidence.journal.series]
        assert all(moment(utc) in reason for utc in began), "both dates"
        assert "series 2 is not what was stated of the measurement first" in reason
        assert says in lacking(paper)
    # the first figures again: what was stated first counts
    edit(paper, dict(zip(SMALLER, ("10", "15"), strict=True)) | {"tracker.common.scale_ppm": "17"})
    import_shots(paper.campaign, rows, replace(ImportTerms(), anyway=True))
    assert not list(sources_of(gather(paper.campaign)).restated())


def test_a_certificate_names_tracker_environment_and_who_authorises_it(tmp_path):
    bare = WHOLE.model_copy(update={"authorised_by": "", "robot_type": "", "conditions": ""})
    paper = new_campaign(tmp_path / "c", **FACTS | {"certificate": bare})
    lacks = lacking(paper)
    for key in (
        "certificate.authorised_by", "certificate.robot_type", "instruments.tracker",
        "tracker.serial", "certificate.conditions",
    ):  # fmt: skip
        assert f"`{key}`" in lacks


def test_a_validation_imported_again_with_less_uncertainty_does_not_pass(whole, tmp_path):
    limits = AcceptanceConfig(distance_mean_mm=0.045)
    paper = whole.copy_to(tmp_path / "c", acceptance=limits, **FACTS)
    edit(paper, SOURCE)
    held = declared_set(paper.campaign, "after", paper.folder / "robot-compensated.yaml")
    rows = visits(paper)
    terms = replace(ImportTerms(), anyway=True)
    first = import_validation(paper.campaign, rows, "after", held, terms)
    assert first.campaign_verdict.decision == first.verdict.decision == "not decided"
    again = import_validation(paper.campaign, stating(rows, 0.002), "after", held, terms)
    assert again.verdict.decision == "pass", "by its figures alone"
    assert again.campaign_verdict.decision == "not decided"
    assert broken(again) == [
        "the uncertainty of series 5 is what was stated of the measurement first"
    ]
    assert CERTIFICATE not in page(paper).html
    third = import_validation(paper.campaign, rows, "after", held, terms)
    assert broken(third) == [], "what was stated first counts"


def broken(validated: Validated) -> list[str]:
    """Statements that keep the verdict from a pass."""
    checks = validated.evaluation.checks
    return [check.statement for check in checks if check.decides and check.holds is False]


def visits(paper: PaperCampaign) -> list[ShotRow]:
    """Pairs, and visits of one pose, by the robot as it is, measured elsewhere."""
    tests = {ShotSet.REPEATABILITY, ShotSet.VALIDATION}
    shots = [shot for shot in validation_shots(paper.rng) if shot.purpose in tests]
    poses = np.array([pose_row(shot.pose) for shot in shots])
    joints = paper.controller.inverse(poses).values_or_raise()
    points = TRACKER_FROM_BASE.apply(TRUE.forward(joints).values_or_raise()[:, :3])
    points += paper.rng.normal(0.0, NOISE_MM, points.shape)
    return [
        ShotRow(shot.pair, tuple(q), tuple(point), shot.purpose)
        for shot, q, point in zip(shots, joints.tolist(), points.tolist(), strict=True)
    ]


def test_the_tracker_that_was_recorded_stands_on_the_page_and_a_change_is_named(tmp_path):
    named = {"instruments.tracker": "Acme LT5", "tracker.serial": "'77'"}
    paper = new_campaign(tmp_path / "c", **FACTS)
    edit(paper, named | SOURCE)
    import_shots(paper.campaign, imported_rows(paper))
    edit(paper, {"instruments.tracker": "Best T9"})
    result = page(paper)
    assert ("tracker", "Acme LT5 77") in list(facts(result.evaluation))
    assert "Best T9" not in words_on(result, "item")
    changed = "instruments.tracker 'Acme LT5' → 'Best T9'; the former counts"
    (check,) = [check for check in result.evaluation.checks if check.detail == changed]
    assert not check.decides
    assert any(changed in reason for reason in result.evaluation.verdict.reasons)


def test_a_name_that_is_filled_in_later_contradicts_nothing(tmp_path):
    paper = new_campaign(tmp_path / "c", **FACTS)
    import_shots(paper.campaign, imported_rows(paper))
    edit(paper, {"instruments.tracker": "Best T9"})
    result = page(paper)
    assert ("tracker", "Best T9") in list(facts(result.evaluation))
    assert not any(
        "states the instruments" in check.statement for check in result.evaluation.checks
    )


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
