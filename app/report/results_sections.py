"""The sections on results: verdict, before and after, tests, ISO 9283."""

from collections.abc import Iterator

from app.report.conformity import Requirement
from app.report.contents import Contents
from app.report.iso_table import IsoRow, iso_rows
from app.report.parts import (
    NOTHING,
    Column,
    Paragraph,
    Part,
    Row,
    Section,
    Table,
    number,
    numbers,
    percent_gained,
    words,
)
from app.report.pictures import distance_pictures, test_pictures, workspace_pictures
from app.report.stages import StageView
from app.report.statistics import ErrorSummary, summary
from campaigns.numerics.geometry import Array
from campaigns.validate import AXES
from campaigns.validation_traces import Result

RULE = (
    "Decision rule (ISO 14253-1): a limit is kept only if |e| + U ≤ limit, and broken only if "
    "|e| − U > limit; in between nothing is decided. U = 2 u is the expanded uncertainty of "
    "measurement (k = 2, about 95 %). All passes only if the identification passed, every limit "
    "that is asked for is kept, and the files belong together."
)
VALIDATE = {
    "before": "There is no validation before calibration: `pkmcal validate --stage before`.",
    "after": "There is no validation after calibration: `pkmcal validate --stage after`.",
}
NO_RUN = "Nothing has been measured to identify from: `pkmcal run`, or `pkmcal import`."
NO_IDENTIFICATION = "Nothing has been identified yet: `pkmcal identify`."


def limits_section(contents: Contents) -> Section:
    """What was asked for and what was decided, limit by limit."""
    rows = tuple(_requirement_row(r) for r in contents.verdict.requirements)
    columns = (
        *words("after calibration"),
        *numbers("mm", ("e", "U (k = 2)", "limit")),
        *words("decision"),
    )
    note = (
        "U holds the tracker's uncertainty as stated for each shot; the robot's own scatter is "
        "part of what is judged. Limits are those under `acceptance` in campaign.yaml."
    )
    parts: list[Part] = [Paragraph(RULE), Table("Limits asked for", columns, rows, note)]
    if contents.after is None:
        parts.append(Paragraph(VALIDATE["after"], "missing"))
    return Section("limits", "Decision, limit by limit", tuple(parts))


def gain_section(contents: Contents) -> Section:
    """Before and after in figures and pair by pair."""
    return Section("gain", "Before and after", tuple(_gain_parts(contents)))


def workspace_section(contents: Contents) -> Section:
    """Where the errors are."""
    parts: list[Part] = list(workspace_pictures(contents))
    if contents.errors is None:
        parts.append(Paragraph(NO_RUN, "missing"))
    elif contents.errors.positions is None:
        text = "Too few shots of pairs to fit a frame: errors of position cannot be shown."
        parts.append(Paragraph(text, "missing"))
    elif contents.evidence.identification is None:
        parts.append(Paragraph(NO_IDENTIFICATION, "missing"))
    return Section("workspace", "Errors over the workspace", tuple(parts))


def tests_section(contents: Contents) -> Section:
    """Straightness, rotation, repeatability."""
    parts: list[Part] = list(test_pictures(contents.before, contents.after))
    parts += _missing_stages(contents)
    return Section("tests", "Straightness, rotation, repeatability", tuple(parts))


def iso_section(contents: Contents) -> Section:
    """The figures of ISO 9283 by their symbols."""
    parts: list[Part] = []
    for name, stage in (("before", contents.before), ("after", contents.after)):
        if stage is not None:
            rows = tuple(_iso_row(row) for row in iso_rows(stage))
            columns = (
                *words("symbol", ""),
                Column("value", "mm"),
                Column("n"),
                Column("U (k = 2)", "mm"),
                *words("conditions"),
            )
            parts.append(Table(f"ISO 9283, {name} calibration", columns, rows))
    if parts:
        parts.append(
            Paragraph(
                "A figure keeps its symbol only where it is formed as the standard forms it; how "
                "the test differs from the standard's stands beside it. n counts repetitions. "
                "For n = 1 the robot's scatter is not in U.",
                "note",
            )
        )
    return Section("iso9283", "Figures of ISO 9283", (*parts, *_missing_stages(contents)))


def _gain_parts(contents: Contents) -> Iterator[Part]:
    rows = tuple(_summary_rows(contents))
    if rows:
        columns = (
            *words("errors", ""),
            Column("n"),
            *numbers("mm", ("mean", "σ", "max", "mean + 3σ", "P95")),
        )
        note = (
            "Of absolute values. Fitted and unseen pairs: by the model at the measured joint "
            "angles. Commanded: as the controller moved with the parameters it held."
        )
        yield Table("Errors of distance and position", columns, rows, note)
    tests = tuple(_test_rows(contents))
    if tests:
        columns = (
            *words(""),
            *numbers("mm", ("before", "after")),
            Column("gain"),
            Column("U (k = 2)", "mm"),
        )
        yield Table("Tests of the paper's section IV.E", columns, tests)
    if contents.evidence.run is None:
        yield Paragraph(NO_RUN, "missing")
    elif contents.evidence.identification is None:
        yield Paragraph(NO_IDENTIFICATION, "missing")
    yield from _missing_stages(contents)
    yield from distance_pictures(contents)


def _missing_stages(contents: Contents) -> Iterator[Paragraph]:
    if contents.before is None:
        yield Paragraph(VALIDATE["before"], "missing")
    if contents.after is None:
        yield Paragraph(VALIDATE["after"], "missing")


def _requirement_row(requirement: Requirement) -> Row:
    result = requirement.result
    value = number(result.value_mm) if result else "not measured"
    limit = "none set" if requirement.limit_mm is None else number(requirement.limit_mm)
    decision = requirement.decision or NOTHING
    return requirement.name, value, number(requirement.expanded_mm), limit, decision


def _summary_rows(contents: Contents) -> Iterator[Row]:
    errors, before, after = contents.errors, contents.before, contents.after
    for name, pairs in (
        ("fitted pairs", errors.fitted if errors else None),
        ("unseen pairs", errors.unseen if errors else None),
    ):
        if pairs is not None:
            yield from _two_rows(name, pairs.before_mm, pairs.after_mm)
    yield from _two_rows(
        "commanded pairs",
        before.distances.errors_mm if before and before.distances else None,
        after.distances.errors_mm if after and after.distances else None,
    )
    yield from _two_rows(
        "commanded positions",
        before.absolute_mm if before else None,
        after.absolute_mm if after else None,
    )


def _two_rows(name: str, before: Array | None, after: Array | None) -> Iterator[Row]:
    for stage, errors in (("before", before), ("after", after)):
        if errors is not None:
            yield name, stage, *_summary_cells(summary(errors))


def _summary_cells(found: ErrorSummary) -> Row:
    values = (found.mean, found.sigma, found.max, found.mean_plus_3_sigma, found.p95)
    return str(found.n), *map(number, values)


def _test_rows(contents: Contents) -> Iterator[Row]:
    stages = (contents.before, contents.after)
    results = [("rotation", *(s.turn.moved if s and s.turn else None for s in stages))]
    results += [
        (f"straightness {axis}", *(_straightness(s, axis) for s in stages)) for axis in AXES
    ]
    clouds = (s.cloud.radius if s and s.cloud else None for s in stages)
    results.append(("repeatability, radius", *clouds))
    for name, before, after in results:
        old, new = (None if r is None else r.value_mm for r in (before, after))
        known = after or before
        if known is not None:
            expanded = number(2.0 * known.instrument_mm)
            yield name, number(old), number(new), percent_gained(old, new), expanded


def _straightness(stage: StageView | None, axis: str) -> Result | None:
    line = stage.line(axis) if stage else None
    return line.straightness if line else None


def _iso_row(row: IsoRow) -> Row:
    figure = row.figure
    if figure is None:
        return row.symbol, row.what, NOTHING, NOTHING, NOTHING, row.conditions
    value = number(figure.value_mm, signed=row.symbol == "AD")
    value = f"± {value}" if row.symbol == "RD" else value
    expanded = number(figure.expanded_uncertainty_mm)
    return row.symbol, row.what, value, str(figure.n), expanded, row.conditions
