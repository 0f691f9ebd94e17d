"""Page of the report: sections of plain data, written as one HTML file that needs no network."""

from collections.abc import Iterator
from dataclasses import dataclass
from importlib import resources

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from app.report import record, results, tables
from campaigns.campaign import moment
from campaigns.evaluation.verdict import RULE
from campaigns.evidence import Evaluation
from campaigns.next_step import next_step, state_of
from campaigns.version import VERSION
from drivers.texts import printable

PACKAGE = "app.report"


@dataclass(frozen=True, slots=True, eq=False)
class Page:
    """Page as a document, and what is on it."""

    evaluation: Evaluation
    missing: tuple[str, ...]
    """What is not there, and what would bring it."""
    figures: tuple[str, ...]
    """Names of the figures."""
    html: str


def page_of(evaluation: Evaluation, made_utc: str) -> Page:
    """Draw the figures and write the page."""
    evidence = evaluation.evidence
    config, journal = evidence.campaign.config, evidence.journal
    certificate, lacks = config.certificate, record.certificate_lacks(evaluation)
    robot, generator = evidence.campaign.nominal.robot.name, f"pkmcal {VERSION}"
    times = [moment(series.started_utc) for series in journal.series] if journal else []
    facts = (
        ("certificate number", certificate.number),
        ("customer", certificate.customer),
        ("issued by", certificate.laboratory),
        ("robot", f"{certificate.robot_type} {robot}".strip()),
        ("serial number", config.instruments.robot_serial),
        ("place", config.people.site),
        ("operator", config.people.operator),
        ("campaign", config.name),
        ("first series begun", times[0] if times else ""),
        ("last series begun", times[-1] if times else ""),
        ("date of issue", moment(made_utc)),
        ("software", generator),
        ("notes", config.people.notes),
    )
    every_section = (
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
    sections = [section for section in every_section if section.blocks]
    step = next_step(state_of(evaluation, reported=True))
    before = f"{step.before}, then " if step and step.before else ""
    missing = tuple(_missing(evaluation))
    style = resources.files(PACKAGE).joinpath("page.css").read_text("utf-8")
    html = _template().render(
        title="Calibration certificate" if lacks == [] else "Calibration report",
        number=certificate.number,
        robot=robot,
        campaign=config.name,
        simulated=evidence.simulated,
        facts=[fact for fact in facts if fact[1]],
        journal=journal,
        alarms=list(_alarms(evaluation)),
        verdict=evaluation.verdict,
        key_figures=tables.key_figure_rows(evaluation),
        next_step=f"{before}`{step.text}`" if step else "",
        rule=RULE,
        traceability=record.traceability(evidence),
        generator=generator,
        missing=missing,
        sections=sections,
        style=Markup(style),  # noqa: S704
    )
    blocks = [block for section in sections for block in section.blocks]
    figures = tuple(block.name for block in blocks if block.form == "figure")
    return Page(evaluation, missing, figures, html)


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
    yield from record.faults(evaluation)


def _template() -> Template:
    environment = Environment(
        loader=PackageLoader(PACKAGE, "."),
        autoescape=True,
        finalize=_cleaned,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["prose"] = _prose
    return environment.get_template("page.html.jinja")


def _cleaned(value: object) -> object:
    """Return texts of devices and files without control characters; markup is ours and stays."""
    return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def _prose(text: str) -> Markup:
    """Return a sentence in which `backticks` are commands."""
    pieces = printable(text).split("`")
    marked = (Markup("<code>{}</code>").format(p) if k % 2 else p for k, p in enumerate(pieces))
    return Markup("").join(marked)
