"""Page of the report: sections of plain data, written as one HTML file that needs no network."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib import resources

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from app.report import record, results, tables
from app.report.section import Section, moment
from campaigns.evaluation.verdict import RULE, CampaignVerdict
from campaigns.evidence import Evaluation
from campaigns.files.table import Row
from campaigns.next_step import next_step, state_of
from campaigns.version import VERSION
from drivers.texts import printable

PACKAGE = "app.report"


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
    """What must not be overlooked."""
    verdict: CampaignVerdict
    key_figures: list[Row]
    """Name, before, after, and what the change shows."""
    next_step: str
    rule: str
    generator: str
    missing: tuple[str, ...]
    """What is not there, and what would bring it."""
    sections: tuple[Section, ...]

    @property
    def figures(self) -> list[str]:
        """Names of the figures."""
        blocks = (block for section in self.sections for block in section.blocks)
        return [block.name for block in blocks if block.form == "figure"]


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
    return Page(evaluation, context, template.render(page=context, style=style))


def report_context(evaluation: Evaluation, made_utc: str) -> ReportContext:
    """Return all that stands on the page."""
    evidence = evaluation.evidence
    config, journal = evidence.campaign.config, evidence.journal
    step = next_step(state_of(evaluation, reported=True))
    before = f"{step.before}, then " if step and step.before else ""
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
    sections = (
        results.limits_section(evaluation),
        results.gain_section(evaluation),
        results.workspace_section(evaluation),
        results.motion_tests_section(evaluation),
        results.parameters_section(evaluation),
        results.budget_section(evaluation),
        record.item_section(evaluation),
        record.tracker_section(evaluation),
        record.incidents_section(evaluation),
        record.provenance_section(evaluation),
    )
    return ReportContext(
        robot=robot,
        campaign=config.name,
        simulated=evidence.simulated,
        facts=tuple(fact for fact in facts if fact[1]),
        journal=journal.digest if journal else "",
        records=journal.records if journal else 0,
        alarms=tuple(_alarms(evaluation)),
        verdict=evaluation.verdict,
        key_figures=tables.key_figure_rows(evaluation),
        next_step=f"{before}`{step.text}`" if step else "",
        rule=RULE,
        generator=generator,
        missing=tuple(_missing(evaluation)),
        sections=tuple(section for section in sections if section.blocks),
    )


def _alarms(evaluation: Evaluation) -> Iterator[str]:
    """Yield what must not be overlooked: a load without its end, a check that found a change."""
    evidence = evaluation.evidence
    if evidence.journal and (unended := evidence.journal.unended_load):
        yield f"{unended[0].upper()}{unended[1:]}."
    if check := evidence.unanswered:
        yield f"Check, series {check.series}: {check.says}."


def _missing(evaluation: Evaluation) -> Iterator[str]:
    """Yield what the page would show and the campaign does not have, and what would bring it."""
    evidence = evaluation.evidence
    journal, run, found = evidence.journal, evidence.run, evidence.identification
    if journal is None:
        yield "There is no journal: nothing was ever measured in this campaign."
    if run is None:
        yield "Nothing has been measured to identify from: `pkmcal run`, or `pkmcal import`."
    elif evaluation.errors is None or evaluation.errors.positions is None:
        yield "Too few shots of pairs to fit a frame: errors of position cannot be shown."
    if found is None:
        yield "Nothing has been identified yet: `pkmcal identify`."
    elif found.covariance is None:
        yield "The identification states no correlations."
    command = "import" if run and run.series.started.imported else "validate"
    for stage, result in (("before", evaluation.before), ("after", evaluation.after)):
        if result is None:
            yield f"There is no validation {stage} calibration: `pkmcal {command} --stage {stage}`."
    if journal is not None and not evaluation.time_series:
        yield "Neither temperature nor drift was recorded."
    yield from record.faults(evidence)


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
