"""A study's picture: errors against the normal distribution, honesty by parameter, what is left."""

from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from app.report.figures.drawing import in_house_style, new_figure
from app.report.figures.picture import AFTER, BEFORE, GRID, INK, QUIET
from app.study.errors import Compared
from campaigns.estimation.information import CONFIDENCE
from campaigns.studies.study import chunks
from campaigns.studies.summary import CHUNK, normal_scores

Line = Literal["-", "--", ":", "-."]

COLOURS = (AFTER, BEFORE, "#98281f", "#5f8f6b", "#7a5c99", QUIET)
MARKS = "osD^vP"
LINES: tuple[Line, ...] = ("-", "--", ":", "-.")
SCORES = np.linspace(-4.0, 4.0, 65)
"""Edges of the histogram of normal scores."""
MOST_POINTS = 400
"""Of a line that is drawn."""
DODGE = 0.6
"""Of a parameter's place, over which combinations stand side by side."""


Look = tuple[str, str, Line]
"""Colour, mark and line by which a combination is drawn: two tell it in grey print too."""


@in_house_style
def study_picture(compared: Sequence[Compared]) -> Figure:
    """All combinations in every panel."""
    figure = new_figure(190.0)
    panels = figure.subplot_mosaic(
        [["scores", "unseen"], ["ratio", "ratio"], ["covered", "covered"]],
        height_ratios=[1.1, 1.0, 1.0],
    )
    looks = _looks(len(compared))
    for one, look in zip(compared, looks, strict=True):
        _scores(panels["scores"], one, look)
        _unseen(panels["unseen"], one, look)
    _standard_normal(panels["scores"])
    _label_unseen(panels["unseen"])
    _ratios(panels["ratio"], compared, looks)
    _coverage(panels["covered"], compared, looks)
    figure.legend(handles=_handles(compared, looks), loc="outside upper left", ncols=2)
    return figure


def _looks(count: int) -> list[Look]:
    return [
        (COLOURS[place % len(COLOURS)], MARKS[place % len(MARKS)], LINES[place % len(LINES)])
        for place in range(count)
    ]


def _handles(compared: Sequence[Compared], looks: Sequence[Look]) -> list[Line2D]:
    """Line and mark of each combination for the legend."""
    return [
        Line2D(
            [],
            [],
            color=colour,
            marker=mark,
            linestyle=line,
            label=f"{one.label} ({one.summary.campaigns} campaigns)",
        )
        for one, (colour, mark, line) in zip(compared, looks, strict=True)
    ]


def _scores(axes: Axes, one: Compared, look: Look) -> None:
    """How often which error in stated σ was found, all parameters together."""
    colour, _, line = look
    setup, count = one.combination.setup, one.summary.campaigns * len(one.summary.parameters)
    found = (normal_scores(setup, some) for some in chunks(one.studied.rows, CHUNK))
    counts = sum(np.histogram(scores, SCORES)[0] for scores in found)
    density = counts / (count * np.diff(SCORES))
    axes.stairs(density, SCORES, color=colour, linestyle=line, linewidth=1.1)


def _standard_normal(axes: Axes) -> None:
    density = np.exp(-0.5 * SCORES**2) / np.sqrt(2.0 * np.pi)
    axes.fill_between(SCORES, density, color=GRID, zorder=0.5)
    axes.set_title("errors of all parameters, in stated σ")
    axes.set(xlabel="error / stated σ (grey: standard normal)", ylabel="density")


def _unseen(axes: Axes, one: Compared, look: Look) -> None:
    """In which share of campaigns the mean error of hold-out distances stays below."""
    found = (row.estimate.unseen_mean_mm for row in one.studied.rows if row.estimate is not None)
    means = [mean for mean in found if mean is not None]
    if not means:
        return
    colour, _, line = look
    shares = np.linspace(0.0, 1.0, min(len(means), MOST_POINTS))
    axes.plot(np.quantile(means, shares), 100.0 * shares, color=colour, linestyle=line)


def _label_unseen(axes: Axes) -> None:
    axes.set_title("what is left on hold-out distances")
    axes.set(xlabel="mean error of a campaign, mm", ylabel="campaigns below, %", ylim=(0.0, 100.0))
    axes.locator_params(axis="x", nbins=5)
    if axes.lines:
        axes.set_xlim(left=0.0)
    else:
        axes.text(0.5, 0.5, "no hold-out pairs", transform=axes.transAxes, ha="center", color=QUIET)


def _ratios(axes: Axes, compared: Sequence[Compared], looks: Sequence[Look]) -> None:
    axes.set_title("σ found / σ stated (grey: what chance may do)")
    _band(axes, [one.summary.chance.ratio for one in compared], 1.0)
    values = ([p.ratio for p in one.summary.parameters] for one in compared)
    _by_parameter(axes, values, looks)
    axes.set_xticks(range(len(_names(compared))), [])


def _coverage(axes: Axes, compared: Sequence[Compared], looks: Sequence[Look]) -> None:
    axes.set_title("share of 95 % intervals that hold the truth (grey: what chance may do)")
    _band(axes, [one.summary.chance.covered for one in compared], CONFIDENCE)
    values = ([p.covered for p in one.summary.parameters] for one in compared)
    _by_parameter(axes, values, looks)
    axes.set_xticks(range(len(_names(compared))), _names(compared), rotation=90)


def _names(compared: Sequence[Compared]) -> list[str]:
    return [p.name for p in compared[0].summary.parameters]


def _band(axes: Axes, limits: Sequence[tuple[float, float]], honest: float) -> None:
    """The widest of the limits, and the value that is right."""
    axes.axhspan(min(low for low, _ in limits), max(high for _, high in limits), color=GRID)
    axes.axhline(honest, color=INK, linewidth=0.6)


def _by_parameter(axes: Axes, values: Iterable[Sequence[float]], looks: Sequence[Look]) -> None:
    """A mark a parameter, combinations side by side."""
    aside = (np.arange(len(looks)) - 0.5 * (len(looks) - 1)) * DODGE / len(looks)
    for one, (colour, mark, _), away in zip(values, looks, aside.tolist(), strict=True):
        axes.plot(np.arange(len(one)) + away, one, mark, color=colour, markersize=3.0)
