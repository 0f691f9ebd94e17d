"""The page: the paper's figures beside ours, in the words of reproduction-sections.jinja."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from app.papers.corbel2006 import figures
from app.papers.corbel2006.comparison import (
    HIGH,
    LOW,
    Comparison,
    Distribution,
    ParameterRow,
    of_experiment,
)
from app.papers.corbel2006.comparison import Row as Compared
from app.papers.corbel2006.evidence import Evidence, Floor, Reach
from app.papers.corbel2006.printed import LINES_MM, Group, printed
from app.papers.corbel2006.quantities import largest
from app.papers.corbel2006.trials import EXPERIMENTS, PROTOTYPE, TrialResult
from app.report.figures.distances import pair_errors
from app.report.groups import PairGroup
from app.report.rendering import rendered
from campaigns.files.table import Column, number, words

PACKAGE = "app.papers.corbel2006"
PASSED = {True: "pass", False: "missed", None: ""}
PARAMETER_DECIMALS = 2
TITLES = {
    "table_2": "Table II: estimated errors of the parameters, mm or deg",
    "floors": "What noise alone leaves on a robot that is perfectly known, mm",
    "reaches": "What a robot reaches on a 25 mm grid over the whole space at θ = 0, mm",
}
SPREAD = f"{LOW:g}–{HIGH:g} %"


def page_html(
    results: Sequence[TrialResult], comparison: Comparison, evidence: Evidence, made_utc: str
) -> str:
    """Draw the figures and write the document."""
    values = {
        "comparison": comparison,
        "evidence": evidence,
        "results": {each.name: of_experiment(results, each) for each in EXPERIMENTS},
        "computing_s": sum(result.seconds for result in results),
        "made_utc": made_utc,
        "mean_before": printed(PROTOTYPE, "mean, before"),
        "max_before": printed(PROTOTYPE, "max, before"),
        "figure_columns": figure_columns(comparison),
        "title_of": title_of,
        "titles": TITLES,
        "TABLE_2": TABLE_2,
        "FLOORS": FLOORS,
        "REACHES": REACHES,
        "NEEDED": NEEDED,
        "middle_seed": middle_seed,
        "pair_groups": pair_groups,
        "pair_errors": pair_errors,
        "figures": figures,
    }
    return rendered("reproduction.html.jinja", values, package=PACKAGE)[0]


def title_of(group: Group, rows: Sequence[Compared]) -> str:
    """Title of a group's table."""
    seeds = rows[0].ours.seeds
    return f"{group.title} (mm, {seeds} seed{'' if seeds == 1 else 's'})"


def figure_columns(comparison: Comparison) -> tuple[Column[Compared], ...]:
    """Columns of a group of figures."""
    return (
        words("", lambda row: row.figure.name),
        Column("paper", lambda row: row.written(row.figure.printed) or None),
        Column("ours", lambda row: row.written(row.ours.median)),
        Column(SPREAD, lambda row: _spread(row.ours, row.quantity.decimals)),
        Column("asked", lambda row: row.written(row.figure.asked)),
        Column("", lambda row: PASSED[row.passed]),
        Column("why", comparison.letter),
    )


TABLE_2: tuple[Column[ParameterRow], ...] = (
    words("parameter", lambda row: row.name),
    Column("paper", lambda row: row.paper, decimals=PARAMETER_DECIMALS, signed=True),
    Column("ours", lambda row: row.ours.median, decimals=PARAMETER_DECIMALS, signed=True),
    Column(SPREAD, lambda row: _spread(row.ours, PARAMETER_DECIMALS, signed=True)),
    Column(
        "difference",
        lambda row: row.ours.median - row.paper,
        decimals=PARAMETER_DECIMALS,
        signed=True,
    ),
    Column("stated σ", lambda row: row.std, decimals=PARAMETER_DECIMALS),
)

FLOORS: tuple[Column[Floor], ...] = (
    words("test", lambda floor: floor.name),
    words("noise", lambda floor: floor.noise),
    Column("median", lambda floor: floor.left.median),
    Column(SPREAD, lambda floor: _spread(floor.left, 3)),
    Column("paper", lambda floor: ", ".join(floor.paper)),
)


def _line_mm(axis: int, reach: Reach) -> str:
    return f"{reach.lines_mm[axis]:g}"


REACHES: tuple[Column[Reach], ...] = (
    words("robot", lambda reach: reach.name),
    Column("points reached", lambda reach: "" if reach.points is None else reach.points),
    *(
        Column(head, partial(_line_mm, axis))
        for axis, head in enumerate(("longest line x", "y", "z"))
    ),
)
NEEDED = Reach("needed, section IV.E", None, LINES_MM)


def middle_seed(results: Sequence[TrialResult]) -> TrialResult:
    """Seed whose largest error after calibration is nearest to the median, the first of several."""
    after_mm = np.array([largest(result.fitted.after_mm) for result in results])
    return results[int(np.argmin(np.abs(after_mm - np.median(after_mm))))]


def pair_groups(result: TrialResult) -> list[PairGroup]:
    """Pairs of a seed, fitted and unseen."""
    return [
        PairGroup(name, marker, np.array(errors.before_mm), np.array(errors.after_mm))
        for name, marker, errors in (
            ("fitted pairs", "o", result.fitted),
            ("hold-out pairs", "D", result.unseen),
        )
    ]


def _spread(ours: Distribution, decimals: int, *, signed: bool = False) -> str:
    low, high = (number(value, decimals, signed=signed) for value in (ours.low, ours.high))
    return f"{low} … {high}"
