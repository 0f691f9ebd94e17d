"""The page: the paper's figures beside ours, in the words of reproduction-sections.jinja."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from app.papers.corbel2006 import figures
from app.papers.corbel2006.comparison import HIGH, LOW, Comparison, Distribution, of_experiment
from app.papers.corbel2006.comparison import Row as Compared
from app.papers.corbel2006.evidence import Evidence
from app.papers.corbel2006.printed import LINES_MM, printed
from app.papers.corbel2006.quantities import largest
from app.papers.corbel2006.trials import EXPERIMENTS, PROTOTYPE, TrialResult
from app.report.figures.distances import PairGroup, pair_errors
from app.report.parts import Section
from app.report.rendering import GENERATOR, rendered, sections_of
from campaigns.files.table import Row, number

PACKAGE = "app.papers.corbel2006"
PASSED = {True: "pass", False: "missed", None: ""}
PARAMETER_DECIMALS = 2


@dataclass(frozen=True, slots=True)
class Page:
    """What the template fills in; no figure is drawn yet."""

    comparison: Comparison
    computing_s: float
    made_utc: str
    sections: tuple[Section, ...]
    generator: str = GENERATOR


def page_of(
    results: Sequence[TrialResult], comparison: Comparison, evidence: Evidence, made_utc: str
) -> Page:
    """Put the page together."""
    values = {
        "comparison": comparison,
        "evidence": evidence,
        "results": {each.name: of_experiment(results, each) for each in EXPERIMENTS},
        "spread": f"{LOW:g}–{HIGH:g} %",
        "mean_before": printed(PROTOTYPE, "mean, before"),
        "max_before": printed(PROTOTYPE, "max, before"),
        "figure_rows": figure_rows,
        "parameter_rows": parameter_rows,
        "floor_rows": floor_rows,
        "reach_rows": reach_rows,
        "middle_seed": middle_seed,
        "pair_groups": pair_groups,
        "pair_errors": pair_errors,
        "figures": figures,
    }
    sections = sections_of("reproduction-sections.jinja", values, package=PACKAGE)
    return Page(comparison, sum(result.seconds for result in results), made_utc, sections)


def page_html(page: Page) -> str:
    """Draw the figures and write the document."""
    return rendered("reproduction.html.jinja", page, package=PACKAGE)


def figure_rows(comparison: Comparison, rows: Iterable[Compared]) -> Iterator[Row]:
    """Rows of a group of figures."""
    for row in rows:
        yield (
            row.figure.name,
            row.written(row.figure.printed) or number(None),
            row.written(row.ours.median),
            _spread(row.ours, row.quantity.decimals),
            row.written(row.figure.asked),
            PASSED[row.passed],
            comparison.letter(row),
        )


def parameter_rows(comparison: Comparison) -> Iterator[Row]:
    """Rows of Table II."""
    for row in comparison.parameters:
        found = (row.printed, row.ours.median, row.ours.median - row.printed)
        paper, ours, apart = (number(each, PARAMETER_DECIMALS, signed=True) for each in found)
        spread = _spread(row.ours, PARAMETER_DECIMALS, signed=True)
        yield row.name, paper, ours, spread, apart, number(row.std, PARAMETER_DECIMALS)


def floor_rows(evidence: Evidence) -> Iterator[Row]:
    """Rows of what noise alone leaves."""
    for floor in evidence.floors:
        left, paper = floor.left, ", ".join(floor.paper)
        yield floor.name, floor.noise, number(left.median), _spread(left, 3), paper


def reach_rows(evidence: Evidence) -> tuple[Row, ...]:
    """Rows of what robots reach, and last what the tests need."""
    reached = [
        (reach.name, str(len(reach.points_mm)), *map("{:g}".format, reach.lines_mm))
        for reach in evidence.reaches
    ]
    return *reached, ("needed, section IV.E", "", *map("{:g}".format, LINES_MM))


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
            ("unseen pairs", "D", result.unseen),
        )
    ]


def _spread(ours: Distribution, decimals: int, *, signed: bool = False) -> str:
    low, high = (number(value, decimals, signed=signed) for value in (ours.low, ours.high))
    return f"{low} … {high}"
