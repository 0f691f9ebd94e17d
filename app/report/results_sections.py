"""The sections on results: verdict, before and after, tests, ISO 9283."""

from collections.abc import Iterator
from dataclasses import replace

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
from campaigns.arrays import Array
from campaigns.evaluation.decision import Requirement
from campaigns.evaluation.iso_figures import IsoRow, iso_rows
from campaigns.evaluation.summary import ErrorSummary, summary
from campaigns.evaluation.validation import AXES
from campaigns.evidence import Evaluation

VALIDATE = {
    "before": "There is no validation before calibration: `pkmcal validate --stage before`.",
    "after": "There is no validation after calibration: `pkmcal validate --stage after`.",
}
ISO_NOTE = (
    "A figure has its symbol only where it is formed as the standard forms it. n: repetitions; U: "
    "k = 2; for n = 1 the robot's scatter is not in U."
)
NO_RUN = "Nothing has been measured to identify from: `pkmcal run`, or `pkmcal import`."
NO_IDENTIFICATION = "Nothing has been identified yet: `pkmcal identify`."


def limits_section(contents: Evaluation) -> Section:
    """What was asked for and what was decided, limit by limit."""
    rows = tuple(_requirement_row(r) for r in contents.verdict.requirements)
    columns = (
        *words("after calibration"),
        *numbers("mm", ("e", "U", "limit")),
        *words("decision"),
    )
    note = (
        "U holds the tracker's uncertainty as stated for each shot; the robot's own scatter is "
        "part of what is judged. Limits are those under `acceptance` in campaign.yaml."
    )
    parts: list[Part] = [Table("Limits asked for", columns, rows, note)]
    if contents.after is None:
        parts.append(Paragraph(VALIDATE["after"], "missing"))
    return Section("limits", "Decision, limit by limit", tuple(parts))


def gain_section(contents: Evaluation) -> Section:
    """Before and after in figures and pair by pair."""
    return Section("gain", "Before and after", tuple(_gain_parts(contents)))


def workspace_section(contents: Evaluation) -> Section:
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


def tests_section(contents: Evaluation) -> Section:
    """Straightness, rotation, repeatability."""
    parts: list[Part] = list(test_pictures(contents.before, contents.after))
    parts += _missing_stages(contents)
    return Section("tests", "Straightness, rotation, repeatability", tuple(parts))


def iso_section(contents: Evaluation) -> Section:
    """The figures of ISO 9283 by their symbols."""
    stages = [iso_rows(s) if s else None for s in (contents.before, contents.after)]
    known = [rows for rows in stages if rows is not None]
    parts: list[Part] = []
    if known:
        columns = (
            *words("symbol", "figure"),
            Column("n"),
            *numbers("mm", ("before", "U", "after", "U")),
            *words("tested here; in the standard"),
        )
        nothing = tuple(replace(row, figure=None) for row in known[0])
        pairs = zip(*(rows or nothing for rows in stages), strict=True)
        rows = tuple(_iso_row(before, after) for before, after in pairs)
        parts.append(Table("Before and after calibration", columns, rows, ISO_NOTE))
    return Section("iso9283", "Figures of ISO 9283", (*parts, *_missing_stages(contents)))


def _gain_parts(contents: Evaluation) -> Iterator[Part]:
    rows = tuple(_summary_rows(contents))
    if rows:
        columns = (
            *words("errors", ""),
            Column("n"),
            *numbers("mm", ("mean", "σ", "max", "mean + 3σ", "P95")),
        )
        note = (
            "Of absolute values. Fitted positions, fitted and unseen pairs: by the model at the "
            "measured joint angles. Commanded: as the controller moved with the parameters it held."
        )
        yield Table("Errors of distance and position", columns, rows, note)
    tests = tuple(_test_rows(contents))
    if tests:
        columns = (
            *words(""),
            *numbers("mm", ("before", "after", "U")),
            Column("gain"),
        )
        yield Table("Rotation, straightness, repeatability", columns, tests, "U: k = 2.")
    if contents.evidence.run is None:
        yield Paragraph(NO_RUN, "missing")
    elif contents.evidence.identification is None:
        yield Paragraph(NO_IDENTIFICATION, "missing")
    yield from _missing_stages(contents)
    yield from distance_pictures(contents)


def _missing_stages(contents: Evaluation) -> Iterator[Paragraph]:
    if contents.before is None:
        yield Paragraph(VALIDATE["before"], "missing")
    if contents.after is None:
        yield Paragraph(VALIDATE["after"], "missing")


def _requirement_row(requirement: Requirement) -> Row:
    value = "not measured" if requirement.error is None else number(requirement.error)
    limit = "none set" if requirement.limit is None else number(requirement.limit)
    decision = requirement.decision or NOTHING
    return requirement.name, value, number(requirement.expanded_uncertainty), limit, decision


def _summary_rows(contents: Evaluation) -> Iterator[Row]:
    errors, before, after = contents.errors, contents.before, contents.after
    if errors is not None and errors.shots is not None:
        sizes = (errors.shots.before_mm, errors.shots.after_mm)
        yield from _two_rows("fitted positions", *sizes)
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


def _test_rows(contents: Evaluation) -> Iterator[Row]:
    figures = [found.figures() if found else {} for found in (contents.before, contents.after)]
    for name in TESTS:
        before, after = (found.get(name) for found in figures)
        known = after or before
        if known is not None:
            old, new = (None if length is None else length.value_mm for length in (before, after))
            expanded = number(known.expanded_uncertainty_mm)
            yield name, number(old), number(new), expanded, percent_gained(old, new)


TESTS = (
    "rotation",
    *(f"straightness along {axis}" for axis in AXES),
    "repeatability, radius of the sphere",
)


def _iso_row(before: IsoRow, after: IsoRow) -> Row:
    shown = after if after.figure else before
    n = str(shown.figure.n) if shown.figure else NOTHING
    return shown.symbol, shown.what, n, *_iso_cells(before), *_iso_cells(after), shown.conditions


def _iso_cells(row: IsoRow) -> Row:
    figure = row.figure
    if figure is None:
        return NOTHING, NOTHING
    value = number(figure.value_mm, signed=row.symbol == "AD")
    value = f"± {value}" if row.symbol == "RD" else value
    return value, number(figure.expanded_uncertainty_mm)
