"""Page of the report: sections of plain data, written as one HTML file that needs no network.

What comes in is an `Evaluation`: all that was measured, identified and decided in a campaign. Each
function of `results.py` and `record.py` makes one section of it, tables and figures as plain data.
A section without content is left out, and `_missing` lists what the campaign lacks, with the
command that would bring it; so a page can be made at any time, also of an empty or broken campaign.
The template then writes all of it into one file, style sheet and figures included: a record must
be readable in ten years and without a network.

Equal evidence and an equal time give an equal page, byte by byte. The page holds the digest of the
journal's records, by which `pkmcal check-journal --page` recognizes pages of other journals.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from importlib import resources

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from app.report import record, results, tables
from campaigns.assessment import Evaluation
from campaigns.evaluation.verdict import RULE
from campaigns.next_step import state_of
from campaigns.version import VERSION
from campaigns.workflow.next_hint import next_hint
from drivers.texts import moment, printable

PACKAGE = "app.report"


@dataclass(frozen=True, slots=True, eq=False)
class Page:
    """Page as a document, and a list of its contents."""

    evaluation: Evaluation
    missing: tuple[str, ...]
    """Parts that the campaign lacks, each with the command that brings it."""
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
        ("serial number", evidence.named_instruments.names["instruments.robot_serial"]),
        ("tracker", record.tracker_in_words(evidence)),
        ("conditions", certificate.conditions),
        ("place", config.people.site),
        ("operator", config.people.operator),
        ("authorised by", certificate.authorised_by),
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
        results.observations_section(evaluation),
        results.parameters_section(evaluation),
        results.course_section(evaluation),
        results.budget_section(evaluation),
        record.item_section(evaluation),
        record.tracker_section(evaluation),
        record.incidents_section(evaluation),
        record.provenance_section(evaluation),
    )
    sections = [section for section in every_section if section.blocks]
    # the next step as after `pkmcal report`: the page must not ask for the report that it is
    step = next_hint(evidence.campaign, state_of(evaluation, reported=True))
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
        warnings=evidence.warnings,
        key_figures=tables.key_figure_rows(evaluation),
        next_step=f"{before}`{step.text}`" if step else "",
        rule=f"{RULE} {_uncertainty(evaluation)}".strip(),
        traceability=record.traceability(evidence),
        generator=generator,
        missing=missing,
        sections=sections,
        style=Markup(style),  # noqa: S704
    )
    blocks = [block for section in sections for block in section.blocks]
    figures = tuple(block.name for block in blocks if block.form == "figure")
    return Page(evaluation, missing, figures, html)


def _uncertainty(evaluation: Evaluation) -> str:
    """Return what the U of the commanded robot's figures contains; empty without figures."""
    if evaluation.before is None and evaluation.after is None:
        return ""
    return f"{evaluation.scatter.says}. {record.points_source(evaluation.evidence)}".strip()


def _alarms(evaluation: Evaluation) -> Iterator[str]:
    """Yield what must stand above the verdict: a load without an end, a check with a change."""
    evidence = evaluation.evidence
    if evidence.journal and (unended := evidence.journal.unended_load):
        yield f"{unended[0].upper()}{unended[1:]}."
    if check := evidence.unanswered:
        yield f"Check, series {check.series}: {check.says}."


def _missing(evaluation: Evaluation) -> Iterator[str]:
    """Yield what the campaign lacks for a full page, with the command that brings it."""
    evidence = evaluation.evidence
    journal, run, identification = evidence.journal, evidence.run, evidence.identification
    if journal is None:
        yield "There is no journal: nothing was ever measured in this campaign."
    without_tracker = run is None and bool(evidence.observations.files)
    if without_tracker:
        yield "No tracker has measured: nothing shows errors of position, nor validates them."
    elif run is None:
        yield "Nothing has been measured to identify from: `pkmcal run`, or `pkmcal import`."
    elif evaluation.errors is None or evaluation.errors.positions is None:
        yield "Too few shots of pairs to fit a frame: errors of position cannot be shown."
    if identification is None:
        yield "Nothing has been identified yet: `pkmcal identify`."
    elif identification.uncertainty.covariance is None:
        yield "The identification states no correlations."
    is_elsewhere = run.series.started.imported if run else evidence.campaign.is_offline
    command = "import" if is_elsewhere else "validate"
    for stage, result in (("before", evaluation.before), ("after", evaluation.after)):
        if result is None and not (without_tracker and evidence.campaign.is_offline):
            yield f"There is no validation {stage} calibration: `pkmcal {command} --stage {stage}`."
    if journal is not None and not evaluation.time_series:
        yield "Neither temperature nor drift was recorded."
    yield from record.faults(evaluation)


# Names of robots, notes of operators and answers of devices end up in the page. Three layers keep
# them from being more than text: every value is escaped, control characters (also those that turn
# the direction of writing) are replaced before, and only the style sheet and matplotlib's SVG are
# passed as markup. A name that the template uses and `render` lacks is an error, not an empty
# place.
def _template() -> Template:
    environment = Environment(
        loader=PackageLoader(PACKAGE, "."),
        autoescape=True,
        finalize=_clean,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["prose"] = _prose
    return environment.get_template("page.html.jinja")


def _clean(value: object) -> object:
    """Return a text without control characters; markup and other values as they are."""
    return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def _prose(text: str) -> Markup:
    """Return a sentence as markup, with the words in `backticks` set as code."""
    # split at backticks, every second piece stands between two of them
    pieces = printable(text).split("`")
    marked = (Markup("<code>{}</code>").format(p) if k % 2 else p for k, p in enumerate(pieces))
    return Markup("").join(marked)
