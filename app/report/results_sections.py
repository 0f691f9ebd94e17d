"""Rows of the tables on results: key figures, limits, errors, tests, ISO 9283."""

from collections.abc import Iterator
from dataclasses import replace

from app.report.parts import NOTHING, Row, number, percent_gained
from app.report.plots import pair_groups
from campaigns.arrays import Array
from campaigns.evaluation.decision import Requirement
from campaigns.evaluation.iso_figures import IsoRow, iso_rows
from campaigns.evaluation.summary import summary
from campaigns.evaluation.validation import AXES, MeasuredLength, ValidationResult
from campaigns.evidence import Evaluation

KEY_FIGURES = ("distances, mean error", "distances, largest error", "rotation")
TESTS = (
    "rotation",
    *(f"straightness along {axis}" for axis in AXES),
    "repeatability, radius of the sphere",
)


def key_figure_rows(found: Evaluation) -> tuple[Row, ...]:
    """Rows of the figures for readers who read no further: name, before, after.

    Those of the commanded robot that were measured in at least one stage.
    """
    before, after = (dict(_key_figures(stage)) for stage in (found.before, found.after))
    return tuple(
        (name, number(before.get(name)), number(after.get(name))) for name in {**before, **after}
    )


def limit_rows(requirements: tuple[Requirement, ...]) -> tuple[Row, ...]:
    """Rows of requirements: what, error, U, limit, decision."""
    return tuple(
        (
            each.name,
            "not measured" if each.error is None else number(each.error),
            number(each.expanded_uncertainty),
            "none set" if each.limit is None else number(each.limit),
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


def test_rows(before: ValidationResult | None, after: ValidationResult | None) -> tuple[Row, ...]:
    """Rows of the paper's tests: name, before, after, U, gain."""
    return tuple(_test_rows(*(found.figures() if found else {} for found in (before, after))))


def iso_table_rows(
    before: ValidationResult | None, after: ValidationResult | None
) -> tuple[Row, ...]:
    """Rows of ISO 9283: symbol, figure, n, before and after with U each, conditions."""
    stages = [iso_rows(stage) if stage else None for stage in (before, after)]
    known = next((rows for rows in stages if rows is not None), ())
    nothing = tuple(replace(row, figure=None) for row in known)
    return tuple(
        _iso_row(*pair) for pair in zip(*(rows or nothing for rows in stages), strict=True)
    )


def _key_figures(found: ValidationResult | None) -> Iterator[tuple[str, float]]:
    if found is None:
        return
    figures = found.figures()
    named = {name: figures[name] for name in KEY_FIGURES}
    for name, length in (named | {"straightness, worst line": found.worst_straightness}).items():
        if length is not None:
            yield name, length.value_mm


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


def _test_rows(*stages: dict[str, MeasuredLength | None]) -> Iterator[Row]:
    for name in TESTS:
        before, after = (figures.get(name) for figures in stages)
        known = after or before
        if known is not None:
            old, new = (None if length is None else length.value_mm for length in (before, after))
            expanded = number(known.expanded_uncertainty_mm)
            yield name, number(old), number(new), expanded, percent_gained(old, new)


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
