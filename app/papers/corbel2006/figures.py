"""The figures of the page: the paper's Figs. 7 and 8 anew, and what shows why others differ."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from app.papers.corbel2006.comparison import Row
from app.papers.corbel2006.evidence import PairLengths
from app.papers.corbel2006.floors import Floor
from app.papers.corbel2006.misfit import Reach
from app.papers.corbel2006.printed import Printed
from app.papers.corbel2006.trials import TrialResult
from app.report.figures.drawing import (
    AFTER,
    BEFORE,
    GRID,
    INK,
    QUIET,
    in_house_style,
    legend_above,
    new_figure,
)
from app.report.figures.space import draw_box, flat
from campaigns.arrays import Array
from campaigns.evaluation.validation import AXES

PAPER = "#98281f"
ROW_MM = 5.0
JITTER = 0.16
"""Half the height, of a row's, over which seeds are spread so that none hides another."""
BINS = 40
FAR_MM = 900.0
LEAST_MM = 1e-3
"""Stands for nothing on a logarithmic scale."""
TICKS_MM = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
ROOM_BELOW = 0.7
"""Left of the least value, as a factor; as much is right of the largest."""
BOX_MM = np.array([[-600.0, -600.0, -1000.0], [600.0, 600.0, 400.0]])
SHOWN_GRID_MM = 50.0


@in_house_style
def every_seed(rows: Sequence[tuple[str, Row]]) -> Figure:
    """Each figure in mm: a dot a seed, our median, the paper's value, what is asked."""
    figure = new_figure(24.0 + ROW_MM * len(rows))
    axes = figure.subplots()
    for place, (_, row) in enumerate(rows):
        _asked(axes, float(place), row)
        _seeds_of(axes, float(place), row)
        if row.quantity.printed is not None:
            _mark_paper(axes, float(place), row.quantity.printed)
    least = min(min(row.values) for _, row in rows)
    most = max(max(row.values) for _, row in rows)
    axes.set_xscale("log")
    axes.set_xlim(ROOM_BELOW * least, most / ROOM_BELOW)
    axes.set_xticks([tick for tick in TICKS_MM if ROOM_BELOW * least < tick < most / ROOM_BELOW])
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_yticks(range(len(rows)), [name for name, _ in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_xlabel("mm")
    _first_of_each(figure, axes, 4)
    return figure


@in_house_style
def parameters_missed(series: Sequence[tuple[str, str, Sequence[TrialResult]]]) -> Figure:
    """By how much each parameter is missed: median of all seeds, and their 5 to 95 %."""
    figure = new_figure(78.0)
    names = list(series[0][2][0].parameters)
    parts = [[n for n in names if n.endswith(f"_{unit}")] for unit in ("mm", "deg")]
    every = figure.subplots(1, 2, width_ratios=[len(part) + 1 for part in parts])
    for axes, part, unit in zip(every, parts, ("mm", "°"), strict=True):
        for number, (label, marker, results) in enumerate(series):
            colour = (AFTER, BEFORE, QUIET)[number % 3]
            places = np.arange(len(part), dtype=np.float64) + 0.24 * (
                number - (len(series) - 1) / 2.0
            )
            _missed(axes, places, part, results, colour=colour, marker=marker, label=label)
        axes.set_yscale("log")
        axes.set_xticks(range(len(part)), [_short(name) for name in part], rotation=90)
        axes.set_ylabel(f"estimate − truth, without sign, {unit}")
        axes.set_xlim(-0.7, len(part) - 0.3)
    _first_of_each(figure, every[0], len(series))
    return figure


@in_house_style
def noise_alone(panels: Sequence[tuple[Floor, Sequence[float]]]) -> Figure:
    """What noise alone leaves, where each seed lies, and what the paper printed."""
    figure = new_figure(58.0)
    for axes, (floor, seeds) in zip(figure.subplots(1, len(panels)), panels, strict=True):
        axes.hist(floor.draws_mm, BINS, density=True, color=GRID, label="noise alone, drawn")
        top = axes.get_ylim()[1]
        axes.plot(seeds, np.full(len(seeds), 0.06 * top), "o", color=AFTER, label="our seeds")
        names = AXES if len(floor.paper) == len(AXES) else ("",)
        for paper, name in zip(floor.paper, names, strict=True):
            axes.axvline(_middle(paper), color=PAPER, linewidth=1.2, label="paper")
            axes.text(_middle(paper), top, f" {name}", color=PAPER, va="top")
        axes.set_title(floor.name.split(":")[0])
        axes.set_xlabel("mm")
        axes.set_yticks([])
        axes.set_xlim(left=0.0)
    _first_of_each(figure, figure.axes[0], 3)
    return figure


@in_house_style
def errors_and_lengths(pairs: PairLengths, mean: Printed, largest: Printed) -> Figure:
    """Errors before calibration against the distance commanded, beside the paper's two figures."""
    figure = new_figure(66.0)
    axes = figure.subplots()
    axes.plot(pairs.lengths_mm, pairs.errors_mm, "o", color=BEFORE, markerfacecolor="white")
    longest = FAR_MM
    label = f"{100.0 * pairs.share:.1f} % of the distance"
    axes.plot([0.0, longest], [0.0, pairs.share * longest], color=INK, label=label)
    for paper, style, name in ((mean, "--", "mean"), (largest, ":", "largest")):
        label = f"paper: {name} {paper.text} mm"
        axes.axhline(_middle(paper), color=PAPER, linestyle=style, label=label)
    axes.set(xlim=(0.0, longest), ylim=(0.0, None))
    axes.set_xlabel("commanded distance, mm")
    axes.set_ylabel("error of distance, mm")
    legend_above(figure, axes, 3)
    return figure


@in_house_style
def reached(printed: Reach, ours: Reach) -> Figure:
    """Points of the grid that two robots reach, in the same box; of ours one in eight is drawn."""
    figure = new_figure(80.0)
    left, right = figure.subplots(1, 2)
    coarse = (ours.points_mm % SHOWN_GRID_MM == 0.0).all(axis=1)
    for axes, reach, points, colour in (
        (left, printed, printed.points_mm, PAPER),
        (right, ours, ours.points_mm[coarse], AFTER),
    ):
        draw_box(axes, BOX_MM)
        axes.plot(*flat(points).T, "o", markersize=1.6, color=colour, alpha=0.6)
        axes.set_title(f"{reach.name}: {len(reach.points_mm)} points")
    return figure


def _asked(axes: Axes, place: float, row: Row) -> None:
    asked = row.quantity.asked
    if asked is not None:
        low = max(asked.low, LEAST_MM)
        axes.barh(place, asked.high - low, 0.42, left=low, color=GRID, label="asked of the median")


def _seeds_of(axes: Axes, place: float, row: Row) -> None:
    colour = BEFORE if row.quantity.name.endswith("before") else AFTER
    spread = place + np.linspace(-JITTER, JITTER, len(row.values))
    axes.plot(row.values, spread, "o", markersize=2.2, color=colour, alpha=0.55, label="a seed")
    axes.plot([row.ours.median] * 2, [place - 0.32, place + 0.32], color=INK, label="our median")


def _mark_paper(axes: Axes, place: float, paper: Printed) -> None:
    """A diamond, or for "more than" an arrowhead."""
    marker = ">" if np.isinf(paper.high) else "D"
    axes.plot(_middle(paper), place, marker, color=PAPER, markersize=4.2, label="paper")


def _middle(paper: Printed) -> float:
    """The number that is printed."""
    return paper.low if np.isinf(paper.high) else 0.5 * (paper.low + paper.high)


def _missed(
    axes: Axes,
    places: Array,
    names: Sequence[str],
    results: Sequence[TrialResult],
    *,
    colour: str,
    marker: str,
    label: str,
) -> None:
    missed = np.abs([[r.parameters[name].missed_by for name in names] for r in results])
    low, median, high = np.percentile(missed, (5.0, 50.0, 95.0), axis=0)
    axes.vlines(places, low, high, color=colour, linewidth=0.9)
    axes.plot(places, median, marker, color=colour, markersize=3.4, label=label)


def _short(name: str) -> str:
    """`arm2.joint_offset_deg` as `2 joint offset`."""
    arm, _, field = name.rpartition(".")
    field = field.rpartition("_")[0].replace("_", " ")
    return f"{arm.removeprefix('arm')} {field}".strip()


def _first_of_each(figure: Figure, axes: Axes, columns: int) -> None:
    """A legend over the figure that names each label once."""
    handles, labels = axes.get_legend_handles_labels()
    first = dict(zip(reversed(labels), reversed(handles), strict=True))
    figure.legend(
        list(first.values())[::-1], list(first)[::-1], loc="outside upper left", ncols=columns
    )
