"""Item, people, instruments, the uncertainty budget, and whose page it is."""

from dataclasses import replace
from datetime import date

import numpy as np
import pytest
from paper_campaign import new_campaign
from test_page import page, rows_of, words_of, words_on

from app.cli.report import report
from app.report.record import facts, faults, traceability
from app.report.results import budget_section
from app.report.tables import budget_rows
from campaigns.assessment import Evaluation, evaluate
from campaigns.campaign import open_campaign
from campaigns.errors import ConfigInvalid
from campaigns.files.table import two_digits
from campaigns.settings.sections import (
    CertificateConfig,
    InstrumentsConfig,
    PeopleConfig,
    TrackerCertificateConfig,
    TrackerCommonConfig,
)
from campaigns.shots.shot_sets import ShotSet

TRACKER = TrackerCertificateConfig(
    number="T-9", laboratory="NMI", issued=date(2025, 3, 1), expires=date(2027, 3, 1)
)
WHOLE = CertificateConfig(
    number="C-1",
    customer="Acme, Main Street 1",
    laboratory="Cal Lab",
    authorised_by="C. Dee",
    robot_type="Acme P4",
    tool="flange",
    payload_kg=1.5,
    conditions="doors shut",
    tracker=TRACKER,
)


@pytest.fixture(scope="module")
def certified(tmp_path_factory):
    """A campaign of four shots that states all of a certificate; leave its settings as they are."""
    paper = new_campaign(tmp_path_factory.mktemp("certified") / "c", certificate=WHOLE)
    paper.measure("run", paper.plan(1, 0))
    return paper


def test_who_measured_what_and_when_stands_on_the_page(certified) -> None:
    result = page(certified)
    text = words_on(result)
    for fact in ("Acme, Main Street 1", "Cal Lab", "Acme P4", "1.5 kg", "T-9 of 2025-03-01, NMI"):
        assert fact in text
    for name in ("tracker", "controller", "speed", "measured", "method"):
        assert f" {name} " in words_on(result, "item")
    assert "expired" not in text


def test_the_method_counts_the_shots_that_were_fitted(evaluation: Evaluation) -> None:
    method = dict(facts(evaluation))["method"]
    identification = evaluation.evidence.identification
    fitted, held_out = (
        len(identification.residuals.fitted.numbers),
        len(identification.residuals.unseen.numbers),
    )
    assert f" parameters from {fitted} shots (model full)" in method
    assert method.endswith(f"validated on {held_out} pairs that were not fitted")
    assert fitted < identification.provenance.shots, "those of validation and drift are not fitted"


def test_the_page_is_a_certificate_once_nothing_lacks(tmp_path) -> None:
    paper = new_campaign(
        tmp_path / "c",
        certificate=WHOLE,
        people=PeopleConfig(operator="A. Bee", site="Hall 3"),
        instruments=InstrumentsConfig(robot_serial="P4-7"),
        common=TrackerCommonConfig(data_sheet="Acme 4", typed_by="A. Bee"),
    )
    paper.records_settings = True
    before = page(paper)
    assert "<title>Calibration report" in before.html
    assert "As a calibration certificate this report lacks" in before.missing[-1]
    assert "a validation after calibration" in before.missing[-1]
    paper.validate("after", frozenset({ShotSet.REPEATABILITY}))
    text = page(paper).html
    assert "<title>Calibration certificate" in text
    assert 'content: "Calibration certificate C-1 · journal' in text
    assert "traceable to the SI metre by the tracker's certificate T-9" in words_of(text)


def with_certificate(paper, **changes) -> Evaluation:
    """What is said of a campaign whose certificate states something else."""
    evidence = evaluate(paper.campaign).evidence
    certificate = WHOLE.model_copy(update=changes)
    config = evidence.campaign.config.model_copy(update={"certificate": certificate})
    campaign = replace(evidence.campaign, config=config)
    return Evaluation(replace(evidence, campaign=campaign))


def test_what_a_certificate_lacks_is_named_and_no_traceability_stated(certified) -> None:
    lacks = next(faults(with_certificate(certified, number="")))
    assert "certificate this report lacks" in lacks
    for key in ("certificate.number", "instruments.robot_serial", "people.site", "people.operator"):
        assert f"`{key}`" in lacks
    assert "certificate.customer" not in lacks
    expired = TRACKER.model_copy(update={"expires": date(2026, 3, 1)})
    for tracker, why in (
        (expired, "expired on 2026-03-01"),
        (TrackerCertificateConfig(), "are not all stated"),
    ):
        result = with_certificate(certified, tracker=tracker)
        assert why in " ".join(faults(result))
        assert traceability(result.evidence) == ""


def test_settings_of_the_former_certificate_open_where_they_are_empty(tmp_path) -> None:
    path = new_campaign(tmp_path / "c").folder / "campaign.yaml"
    text = path.read_text(encoding="utf-8")
    path.write_text(f'{text}certificate:\n  measured_by: ""\n', encoding="utf-8")
    open_campaign(path.parent)
    path.write_text(f'{text}certificate:\n  measured_by: "A. Bee"\n', encoding="utf-8")
    with pytest.raises(ConfigInvalid, match=r"measured_by.*people\.operator"):
        open_campaign(path.parent)


def test_the_budget_combines_to_the_stated_uncertainty(evaluation: Evaluation) -> None:
    identification = evaluation.evidence.identification
    *shares, combined = budget_rows(identification)
    sizes = [mm for words, _, mm in shares if not words.endswith(" others")]
    *_, (words, kind, others) = shares
    assert (words.split()[1], kind) == ("others", ""), "what hardly counts has one row"
    assert all(mm >= 0.01 * combined[2] for mm in sizes)
    assert combined[2] == pytest.approx(identification.uncertainty.position_std_mm.rms)
    assert np.hypot(np.linalg.norm(sizes), others) == pytest.approx(combined[2])
    assert sizes == sorted(sizes, reverse=True)
    assert {kind for _, kind, _ in shares} == {"A", "B", ""}
    assert rows_of(budget_section(evaluation))[-1][1] == two_digits(combined[2])


def test_a_page_and_its_journal_are_told_from_others(pkmcal, certified, tmp_path) -> None:
    written = report(open_campaign(certified.folder))[1]
    text = written.read_text(encoding="utf-8")
    with certified.journal() as journal:
        assert journal.digest() in words_of(text)
    certified.measure("before", certified.plan(1, 0))  # it may have grown since
    assert pkmcal("check-journal", certified.folder, "--page", written).code == 0
    digest = text.partition('name="journal-end" content="')[2].partition(":")[2][:64]
    other = tmp_path / "other.html"
    other.write_text(f"{text.replace(digest, digest[::-1])}{' ' * 1_000_000}", "utf-8")
    foreign = pkmcal("check-journal", certified.folder, "--page", other)
    assert (foreign.code, "not made from this journal" in foreign.err) == (1, True)
    other.write_text("<html></html>")
    assert pkmcal("check-journal", certified.folder, "--page", other).code == 2
