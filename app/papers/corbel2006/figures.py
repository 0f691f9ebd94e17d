"""The figures of the page that are not the report's: every seed, and what shows why ours differ."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from app.papers.corbel2006.comparison import HIGH, LOW, Row
from app.papers.corbel2006.evidence import Evidence, PairLengths
from app.papers.corbel2006.printed import allowed
from app.papers.corbel2006.trials import PROTOTYPE, TrialResult
from app.report.figures.drawing import in_house_style, legend_above, new_figure
from app.report.figures.picture import AFTER, BEFORE, GRID, INK, QUIET
from campaigns.arrays import AXES
from campaigns.mechanisms.par4 import PAR4

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
STYLES = {"simulation": ("o", AFTER), "repeatability": ("s", BEFORE), "prototype": ("D", QUIET)}
PANELS = (("rotation", "rotation, after"), ("straightness", "along x, after"))
"""Tests in which noise alone explains what is left, each with our figure."""


@in_house_style
def every_seed(rows: Iterable[Row]) -> Figure:
    """The prototype's figures in mm: a dot a seed, our median, the paper's value, what is asked."""
    shown = [row for row in rows if row.group.experiment is PROTOTYPE and row.quantity.unit == "mm"]
    figure = new_figure(24.0 + ROW_MM * len(shown))
    axes = figure.subplots()
    for place, row in enumerate(shown):
        _draw_row(axes, float(place), row)
    least = ROOM_BELOW * min(min(row.values) for row in shown)
    most = max(max(row.values) for row in shown) / ROOM_BELOW
    axes.set_xscale("log")
    axes.set_xlim(least, most)
    axes.set_xticks([tick for tick in TICKS_MM if least < tick < most])
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_locator(NullLocator())
    names = [f"{row.group.title.split(':')[0]} · {row.figure.name}" for row in shown]
    axes.set_yticks(range(len(shown)), names)
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.set_xlabel("mm")
    legend_above(figure, axes, 4)
    return figure


def _draw_row(axes: Axes, place: float, row: Row) -> None:
    if row.figure.asked:
        low, high = allowed(row.figure.asked)
        low = max(low, LEAST_MM)
        axes.barh(place, high - low, 0.42, left=low, color=GRID, label="asked of the median")
    colour = BEFORE if row.figure.name.endswith("before") else AFTER
    spread = place + np.linspace(-JITTER, JITTER, len(row.values))
    axes.plot(row.values, spread, "o", markersize=2.2, color=colour, alpha=0.55, label="a seed")
    axes.plot([row.ours.median] * 2, [place - 0.32, place + 0.32], color=INK, label="our median")
    if row.figure.printed:
        marker = ">" if row.figure.printed.startswith(">") else "D"
        paper = _middle(row.figure.printed)
        axes.plot(paper, place, marker, color=PAPER, markersize=4.2, label="paper")


@in_house_style
def parameters_missed(results: Mapping[str, Sequence[TrialResult]]) -> Figure:
    """By how much parameters are missed in each experiment: median of all seeds, and spread."""
    figure = new_figure(78.0)
    series = {name: own for name, own in results.items() if own}
    names = list(next(iter(series.values()))[0].parameters)
    parts = [PAR4.parameters.of_unit(unit, names) for unit in ("mm", "deg")]
    every = figure.subplots(1, 2, width_ratios=[len(part) + 1 for part in parts])
    for axes, part, unit in zip(every, parts, ("mm", "°"), strict=True):
        for place, (experiment, own) in enumerate(series.items()):
            missed = np.abs([[r.parameters[name].missed_by for name in part] for r in own])
            low, median, high = np.percentile(missed, (LOW, 50.0, HIGH), axis=0)
            places = np.arange(len(part)) + 0.24 * (place - (len(series) - 1) / 2.0)
            marker, colour = STYLES[experiment]
            axes.vlines(places, low, high, color=colour, linewidth=0.9)
            axes.plot(places, median, marker, color=colour, markersize=3.4, label=experiment)
        axes.set_yscale("log")
        axes.set_xticks(range(len(part)), [_short(name) for name in part], rotation=90)
        axes.set_ylabel(f"estimate − truth, without sign, {unit}")
        axes.set_xlim(-0.7, len(part) - 0.3)
    legend_above(figure, every[0], len(series))
    return figure


@in_house_style
def noise_alone(evidence: Evidence, rows: Iterable[Row]) -> Figure:
    """What noise alone leaves, where each seed lies, and what the paper printed."""
    ours = {row.figure.quantity: row.values for row in rows if row.group.experiment is PROTOTYPE}
    figure = new_figure(58.0)
    for axes, (start, quantity) in zip(figure.subplots(1, len(PANELS)), PANELS, strict=True):
        floor = next(each for each in evidence.floors if each.name.startswith(start))
        seeds = ours[quantity]
        axes.hist(floor.draws_mm, BINS, density=True, color=GRID, label="noise alone, drawn")
        top = axes.get_ylim()[1]
        axes.plot(seeds, np.full(len(seeds), 0.06 * top), "o", color=AFTER, label="our seeds")
        names = AXES if len(floor.paper) == len(AXES) else ("",)
        for paper, name in zip(map(_middle, floor.paper), names, strict=True):
            axes.axvline(paper, color=PAPER, linewidth=1.2, label="paper")
            axes.text(paper, top, f" {name}", color=PAPER, va="top")
        axes.set_title(floor.name.split(":")[0])
        axes.set_xlabel("mm")
        axes.set_yticks([])
        axes.set_xlim(left=0.0)
    legend_above(figure, figure.axes[0], 3)
    return figure


@in_house_style
def errors_and_lengths(pairs: PairLengths, mean: str, largest: str) -> Figure:
    """Errors before calibration against the distance commanded, beside the paper's two figures."""
    figure = new_figure(66.0)
    axes = figure.subplots()
    axes.plot(pairs.lengths_mm, pairs.errors_mm, "o", color=BEFORE, markerfacecolor="white")
    label = f"{100.0 * pairs.share:.1f} % of the distance"
    axes.plot([0.0, FAR_MM], [0.0, pairs.share * FAR_MM], color=INK, label=label)
    for paper, style, name in ((mean, "--", "mean"), (largest, ":", "largest")):
        label = f"paper: {name} {paper} mm"
        axes.axhline(_middle(paper), color=PAPER, linestyle=style, label=label)
    axes.set(xlim=(0.0, FAR_MM), ylim=(0.0, None))
    axes.set_xlabel("commanded distance, mm")
    axes.set_ylabel("error of distance, mm")
    legend_above(figure, axes, 3)
    return figure


def _middle(words: str) -> float:
    """The number that is printed."""
    low, high = allowed(words)
    return low if np.isinf(high) else 0.5 * (low + high)


def _short(name: str) -> str:
    """`arm2.joint_offset_deg` as `2 joint offset`."""
    parameter = PAR4.parameters[name]
    words = parameter.field.words
    return words if parameter.arm is None else f"{parameter.arm} {words}"
