"""The report's page, put together from its sections."""

from collections.abc import Iterator
from dataclasses import dataclass

from app.report.model_sections import parameters_section, remainder_section
from app.report.parts import Row, Section, moment, number
from app.report.record_sections import incidents_section, provenance_section, tracker_section
from app.report.rendering import GENERATOR, rendered
from app.report.results_sections import (
    gain_section,
    iso_section,
    limits_section,
    tests_section,
    workspace_section,
)
from campaigns.evaluation.campaign_verdict import RULE
from campaigns.evaluation.validation import ValidationResult
from campaigns.evidence import Evaluation, Evidence

SECTIONS = (
    limits_section,
    gain_section,
    workspace_section,
    tests_section,
    iso_section,
    parameters_section,
    tracker_section,
    incidents_section,
    remainder_section,
    provenance_section,
)


KEY_FIGURES = ("distances, mean error", "distances, largest error", "rotation")


@dataclass(frozen=True, slots=True)
class KeyFigure:
    """Figure in mm for readers who read no further; a dash where it was not measured."""

    name: str
    before: str
    after: str


@dataclass(frozen=True, slots=True)
class Page:
    """What the template fills in."""

    robot: str
    campaign: str
    simulated: bool
    facts: tuple[Row, ...]
    decision: str
    headline: str
    reasons: tuple[str, ...]
    rule: str
    key_figures: tuple[KeyFigure, ...]
    sections: tuple[Section, ...]
    missing: tuple[tuple[str, str], ...]
    """Each thing once, with the section that lacks it."""
    record: str
    """The journal's digest, for the foot of every printed page; hexadecimal or a dash."""
    generator: str = GENERATOR


def page_of(contents: Evaluation, made_utc: str) -> Page:
    """Put the page together."""
    evidence = contents.evidence
    sections = tuple(section(contents) for section in SECTIONS)
    found = contents.verdict
    return Page(
        evidence.campaign.nominal.robot.name,
        evidence.campaign.config.name,
        evidence.campaign.is_simulated,
        tuple(_facts(evidence, made_utc)),
        found.decision,
        found.headline,
        found.reasons,
        RULE,
        key_figures(contents),
        sections,
        _missing(sections),
        evidence.journal.digest[:16] if evidence.journal else "–",
    )


def page_html(page: Page) -> str:
    """Draw the figures and write the document."""
    return rendered("page.html.jinja", page)


def key_figures(contents: Evaluation) -> tuple[KeyFigure, ...]:
    """Those of the commanded robot that were measured in at least one stage."""
    before, after = (dict(_values(each)) for each in (contents.before, contents.after))
    return tuple(
        KeyFigure(name, number(before.get(name)), number(after.get(name)))
        for name in {**before, **after}
    )


def _values(found: ValidationResult | None) -> Iterator[tuple[str, float]]:
    figures = {} if found is None else found.figures()
    for name in KEY_FIGURES:
        length = figures.get(name)
        if length is not None:
            yield name, length.value_mm
    if found is not None and found.lines:
        yield "straightness, worst line", max(line.straightness.value_mm for line in found.lines)


def _facts(evidence: Evidence, made_utc: str) -> Iterator[Row]:
    config = evidence.campaign.config
    yield "campaign", config.name
    yield "robot", evidence.campaign.nominal.robot.name
    serials = (
        ("serial number", config.instruments.robot_serial),
        ("site", config.people.site),
        ("operator", config.people.operator),
        ("notes", config.people.notes),
    )
    for name, text in serials:
        if text:
            yield name, text
    series = evidence.journal.series if evidence.journal else ()
    if series:
        began, last = series[0].series.started_utc, series[-1].series.started_utc
        yield "first series begun", moment(began)
        yield "last series begun", moment(last)
    yield "report made", moment(made_utc)
    yield "software", GENERATOR


def _missing(sections: tuple[Section, ...]) -> tuple[tuple[str, str], ...]:
    found: dict[str, str] = {}
    for section in sections:
        for text in section.missing:
            found.setdefault(text, section.name)
    return tuple(found.items())
