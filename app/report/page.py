"""Page of the report: sections of plain data, written as one HTML file that needs no network."""

from dataclasses import dataclass
from functools import cache
from importlib import resources

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from app.report import model, record, results
from app.report.result_tables import key_figure_rows
from app.report.section import Section, moment
from campaigns.campaign_state import state_of
from campaigns.evaluation.campaign_verdict import RULE
from campaigns.evidence import Evaluation
from campaigns.files.table import Row
from campaigns.next_step import next_step
from campaigns.version import VERSION
from drivers.texts import printable

PACKAGE = "app.report"
LONG_TABLE = 34
"""A table of more rows may be cut by the end of a printed page."""
SHORT_CELL = 24
"""Letters of a cell that is kept on one line: a word, a time, a name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportContext:
    """What stands on the page, as the template takes it."""

    robot: str
    campaign: str
    simulated: str
    """Sentence on simulated devices, empty if there are none."""
    facts: tuple[Row, ...]
    journal: str
    """Digest of all records; empty without a journal."""
    records: int
    alarms: tuple[str, ...]
    answer: str
    headline: str
    reasons: tuple[str, ...]
    key_figures: tuple[Row, ...]
    """Name, before, after, and what the change shows."""
    next_step: str
    rule: str
    generator: str
    sections: tuple[Section, ...]

    @property
    def missing(self) -> dict[str, str]:
        """What is not there and what would bring it, each with the first section that lacks it."""
        missing: dict[str, str] = {}
        for section in self.sections:
            for text in section.lacks:
                missing.setdefault(text, section.name)
        return missing

    @property
    def figures(self) -> list[str]:
        """Names of the figures."""
        return [name for section in self.sections for name in section.figures]


@dataclass(frozen=True, slots=True, eq=False)
class Page:
    """Page as a document, and what is on it."""

    evaluation: Evaluation
    context: ReportContext
    html: str


def page_of(evaluation: Evaluation, made_utc: str) -> Page:
    """Draw the figures and write the page."""
    context = report_context(evaluation, made_utc)
    template = _environment().get_template("page.html.jinja")
    style = Markup(resources.files(PACKAGE).joinpath("page.css").read_text("utf-8"))  # noqa: S704
    html = template.render(page=context, style=style, LONG=LONG_TABLE, SHORT=SHORT_CELL)
    return Page(evaluation, context, html)


def report_context(evaluation: Evaluation, made_utc: str) -> ReportContext:
    """Return all that stands on the page."""
    evidence, verdict = evaluation.evidence, evaluation.verdict
    config, journal = evidence.campaign.config, evidence.journal
    step = next_step(state_of(evaluation, reported=True))
    command = f"`{step.text}`" if step else ""
    robot, generator = evidence.campaign.nominal.robot.name, f"pkmcal {VERSION}"
    times = [moment(series.started_utc) for series in journal.series] if journal else []
    facts = (
        ("campaign", config.name),
        ("robot", robot),
        ("serial number", config.instruments.robot_serial),
        ("site", config.people.site),
        ("operator", config.people.operator),
        ("notes", config.people.notes),
        ("first series begun", times[0] if times else ""),
        ("last series begun", times[-1] if times else ""),
        ("report made", moment(made_utc)),
        ("software", generator),
    )
    return ReportContext(
        robot=robot,
        campaign=config.name,
        simulated=evidence.simulated,
        facts=tuple(fact for fact in facts if fact[1]),
        journal=journal.digest if journal else "",
        records=journal.records if journal else 0,
        alarms=_alarms(evaluation),
        answer=verdict.answer,
        headline=verdict.headline,
        reasons=tuple(verdict.reasons),
        key_figures=key_figure_rows(evaluation),
        next_step=f"{step.first}, then `{step.text}`" if step and step.first else command,
        rule=RULE,
        generator=generator,
        sections=_sections(evaluation),
    )


def _alarms(evaluation: Evaluation) -> tuple[str, ...]:
    """Return what must not be overlooked: a load without its end, a check that found a change."""
    evidence = evaluation.evidence
    unended = evidence.journal.unended_load if evidence.journal else ""
    check = evidence.unanswered
    return (
        *((f"{unended[0].upper()}{unended[1:]}.",) if unended else ()),
        *((f"Check, series {check.series}: {check.says}.",) if check else ()),
    )


def _sections(evaluation: Evaluation) -> tuple[Section, ...]:
    budget = model.budget_section(evaluation)
    return (
        results.limits_section(evaluation),
        model.findings_section(evaluation),
        results.gain_section(evaluation),
        results.workspace_section(evaluation),
        results.tests_section(evaluation),
        results.iso_section(evaluation),
        model.parameters_section(evaluation),
        record.item_section(evaluation),
        *([budget] if budget else []),
        record.tracker_section(evaluation),
        record.incidents_section(evaluation),
        record.provenance_section(evaluation),
    )


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader(PACKAGE, "."),
        autoescape=True,
        finalize=_cleaned,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["prose"] = _prose
    return environment


def _cleaned(value: object) -> object:
    """Return texts of devices and files without control characters; markup is ours and stays."""
    return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def _prose(text: str) -> Markup:
    """Return a sentence in which `backticks` are commands."""
    pieces = printable(text).split("`")
    marked = (Markup("<code>{}</code>").format(p) if k % 2 else p for k, p in enumerate(pieces))
    return Markup("").join(marked)
