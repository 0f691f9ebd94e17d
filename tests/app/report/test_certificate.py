"""Item, people, instruments, the uncertainty budget, and whose page it is."""

from datetime import date

import pytest
from paper_campaign import PaperCampaign, new_campaign
from test_page import page, rows_of, words_of, words_on

from app.cli.report import report
from app.report.record import facts
from app.report.results import budget_section
from app.report.tables import budget_rows
from campaigns.campaign import open_campaign
from campaigns.errors import ConfigInvalid
from campaigns.evidence import evaluate, gather
from campaigns.settings.sections import (
    CertificateConfig,
    InstrumentsConfig,
    PeopleConfig,
    TrackerCertificateConfig,
)
from campaigns.shots.shot_sets import ShotSet

TRACKER = TrackerCertificateConfig(
    number="T-9", laboratory="NMI", issued=date(2025, 3, 1), expires=date(2027, 3, 1)
)
WHOLE = CertificateConfig(
    number="C-1",
    customer="Acme, Main Street 1",
    laboratory="Cal Lab",
    robot_type="Acme P4",
    tool="flange",
    payload_kg=1.5,
    conditions="doors shut",
    tracker=TRACKER,
)


@pytest.fixture
def certified(tmp_path):
    def made(certificate):
        paper = new_campaign(tmp_path / "c", certificate=certificate)
        paper.run(pairs=20, unseen=4)
        return paper

    return made


def test_who_measured_what_and_when_stands_on_the_page(certified) -> None:
    found = page(certified(WHOLE))
    text = words_on(found)
    for fact in ("Acme, Main Street 1", "Cal Lab", "Acme P4", "1.5 kg", "T-9 of 2025-03-01, NMI"):
        assert fact in text
    for name in ("tracker", "controller", "speed", "measured", "method"):
        assert f" {name} " in words_on(found, "item")
    assert "expired" not in text


def test_the_method_counts_the_shots_that_were_fitted(whole: PaperCampaign) -> None:
    method = dict(facts(evaluate(open_campaign(whole.folder))))["method"]
    found = gather(whole.campaign).identification
    fitted, held_out = len(found.fitted.numbers), len(found.unseen.numbers)
    assert f" parameters from {fitted} shots (model full)" in method
    assert method.endswith(f"validated on {held_out} pairs that were not fitted")
    assert fitted < found.shots, "those of validation and drift are not fitted"


def test_the_page_is_a_certificate_once_nothing_lacks(tmp_path) -> None:
    paper = new_campaign(
        tmp_path / "c",
        certificate=WHOLE,
        people=PeopleConfig(operator="A. Bee", site="Hall 3"),
        instruments=InstrumentsConfig(robot_serial="P4-7"),
    )
    found = page(paper)
    assert "<title>Calibration report" in found.html
    assert "As a calibration certificate this report lacks a validation after" in found.missing[-1]
    paper.validate("after", frozenset({ShotSet.REPEATABILITY}))
    found = page(paper)
    assert "<title>Calibration certificate" in found.html
    assert 'content: "Calibration certificate C-1 · journal' in found.html
    assert "traceable to the SI metre by the tracker's certificate T-9" in words_of(found.html)


def test_what_a_certificate_lacks_is_named(certified, pkmcal) -> None:
    folder = certified(WHOLE.model_copy(update={"number": ""})).folder
    said = pkmcal("report", folder, "--json")
    lacks = next(
        text for text in said.document["missing"] if "certificate this report lacks" in text
    )
    for key in ("certificate.number", "instruments.robot_serial", "people.site", "people.operator"):
        assert f"`{key}`" in lacks
    assert "certificate.customer" not in lacks
    assert f"missing: {lacks[:40]}" in said.err


@pytest.mark.parametrize(
    ("tracker", "why"),
    [
        (TRACKER.model_copy(update={"expires": date(2026, 3, 1)}), "expired on 2026-03-01"),
        (TrackerCertificateConfig(), "are not all stated"),
    ],
)
def test_without_a_valid_certificate_of_the_tracker_no_traceability_is_stated(
    certified, tracker, why
) -> None:
    found = page(certified(CertificateConfig(tracker=tracker)))
    assert why in " ".join(found.missing)
    assert "traceable to the SI metre" not in found.html


def test_settings_of_the_former_certificate_open_where_they_are_empty(tmp_path) -> None:
    path = new_campaign(tmp_path / "c").folder / "campaign.yaml"
    head = "certificate:\n"
    text = path.read_text(encoding="utf-8")
    assert head in text
    empty = f'{head}  measured_by: ""\n  authorised_by: ""\n'
    path.write_text(text.replace(head, empty), encoding="utf-8")
    open_campaign(path.parent)
    path.write_text(text.replace(head, f'{head}  measured_by: "A. Bee"\n'), encoding="utf-8")
    with pytest.raises(ConfigInvalid, match=r"measured_by.*people\.operator"):
        open_campaign(path.parent)


def test_the_budget_combines_to_the_stated_uncertainty(whole: PaperCampaign) -> None:
    found = gather(whole.campaign).identification
    *shares, combined = budget_rows(found)
    assert combined[2] == pytest.approx(found.position_std_mm.rms)
    assert sum(mm**2 for *_, mm in shares) == pytest.approx(combined[2] ** 2)
    sizes = [mm for *_, mm in shares]
    assert sizes == sorted(sizes, reverse=True)
    assert {kind for _, kind, _ in shares} == {"A", "B"}
    rows = rows_of(budget_section(evaluate(whole.campaign)))
    assert [row[0] for row in rows] == [row[0] for row in (*shares, combined)]
    assert rows[-1][1] == f"{combined[2]:.4f}"


def test_a_page_and_its_journal_are_told_from_others(pkmcal, certified, tmp_path) -> None:
    paper = certified(WHOLE)
    _, made = report(open_campaign(paper.folder))
    with paper.journal() as journal:
        assert journal.digest() in words_of(made.read_text("utf-8"))
    paper.measure("before", paper.plan(1, 0))  # it may have grown since
    assert pkmcal("check-journal", paper.folder, "--page", made).code == 0
    text = made.read_text(encoding="utf-8")
    digest = text.partition('name="journal-end" content="')[2].partition(":")[2][:64]
    other = tmp_path / "other.html"
    other.write_text(f"{text.replace(digest, digest[::-1])}{' ' * 1_000_000}", "utf-8")
    foreign = pkmcal("check-journal", paper.folder, "--page", other)
    assert (foreign.code, "not made from this journal" in foreign.err) == (1, True)
    other.write_text("<html></html>")
    assert pkmcal("check-journal", paper.folder, "--page", other).code == 2
