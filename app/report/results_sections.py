"""Rows of the tables on results: key figures, limits, errors, tests, ISO 9283."""

from collections.abc import Iterator
from dataclasses import replace

from app.report.parts import percent_gained
from app.report.plots import pair_groups
from campaigns.arrays import Array
from campaigns.evaluation.decision import Requirement
from campaigns.evaluation.gains import NO_CHANGE, Gain
from campaigns.evaluation.iso_figures import IsoRow, iso_rows
from campaigns.evaluation.summary import summary
from campaigns.evaluation.validation import ValidationResult
from campaigns.evidence import Evaluation
from campaigns.files.table import NOTHING, Row, number

KEY_FIGURES = ("distances, mean error", "distances, largest error", "rotation")
STRAIGHTNESS = "straightness"


def key_figure_rows(found: Evaluation) -> tuple[Row, ...]:
    """Rows of the figures for readers who read no further: name, before, after, what is shown.

    Those of the commanded robot that were measured in at least one stage.
    """
    lines = [gain for gain in found.gains if gain.name.startswith(STRAIGHTNESS)]
    worst = max(lines, key=_larger, default=None)
    chosen = [gain for gain in found.gains if gain.name in KEY_FIGURES]
    return tuple(
        (gain.name, *_both(gain), NO_CHANGE if gain.shown is False else "")
        for gain in (*chosen, *([worst] if worst else []))
    )


def limit_rows(requirements: tuple[Requirement, ...]) -> tuple[Row, ...]:
    """Rows of requirements: what, error, U, limit, margin, decision."""
    return tuple(
        (
            each.name,
            "not measured" if each.error is None else number(each.error),
            number(each.expanded_uncertainty),
            "none set" if each.limit is None else number(each.limit),
            number(each.margin, signed=True),
            each.decision or NOTHING,
        )
        for each in requirements
    )


def error_rows(found: Evaluation) -> tuple[Row, ...]:
    """Rows of errors before and after: what, stage, n, mean, σ, max, mean + 3σ, P95."""
    return tuple(
        (name, stage, *_summary_cells(errors))
        for name, *stages in _compared_errors(found)
        for stage, errors in zip(("before", "after"), stages, strict=True)
        if errors is not None
    )


def gain_rows(found: tuple[Gain, ...]) -> tuple[Row, ...]:
    """Rows of gains: name, before, after, U of the difference, gain."""
    return tuple(
        (gain.name, *_both(gain), number(gain.expanded_uncertainty_mm), _gained(gain))
        for gain in found
    )


def iso_table_rows(
    before: ValidationResult | None, after: ValidationResult | None
) -> tuple[Row, ...]:
    """Rows beside ISO 9283: figure, n, before and after with U each, tested here, the standard."""
    stages = [iso_rows(stage) if stage else None for stage in (before, after)]
    known = next((rows for rows in stages if rows is not None), ())
    nothing = tuple(replace(row, figure=None) for row in known)
    return tuple(
        _iso_row(*pair) for pair in zip(*(rows or nothing for rows in stages), strict=True)
    )


def _compared_errors(found: Evaluation) -> Iterator[tuple[str, Array | None, Array | None]]:
    shots = found.errors.shots if found.errors else None
    if shots is not None:
        yield "fitted positions", shots.before_mm, shots.after_mm
    for group in pair_groups(found):
        yield group.name, group.before_mm, group.after_mm
    before, after = (stage.absolute_mm if stage else None for stage in (found.before, found.after))
    yield "commanded positions", before, after


def _summary_cells(errors_mm: Array) -> Row:
    found = summary(errors_mm)
    values = (found.mean, found.sigma, found.max, found.mean_plus_3_sigma, found.p95)
    return str(found.n), *map(number, values)


def _both(gain: Gain) -> Row:
    both = (gain.before, gain.after)
    return tuple(number(None if each is None else each.value_mm) for each in both)


def _larger(gain: Gain) -> float:
    return max(each.value_mm for each in (gain.before, gain.after) if each is not None)


def _gained(gain: Gain) -> str:
    if gain.before is None or gain.after is None:
        return NOTHING
    if not gain.shown:
        return NO_CHANGE
    return percent_gained(gain.before.value_mm, gain.after.value_mm)


def _iso_row(before: IsoRow, after: IsoRow) -> Row:
    shown = after if after.figure else before
    n = str(shown.n) if shown.figure else NOTHING
    return shown.name, n, *_iso_cells(before), *_iso_cells(after), shown.tested, shown.asked


def _iso_cells(row: IsoRow) -> Row:
    figure = row.figure
    if figure is None:
        return NOTHING, NOTHING
    value = number(figure.value_mm, signed=row.is_signed)
    return value, number(figure.expanded_uncertainty_mm)
