"""Errors of distances: pair by pair (the paper's Fig. 8), as histogram, and over the workspace."""

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from app.report.figures import drawing
from app.report.groups import PairGroup
from campaigns.arrays import Array, Index

GAP = 3
"""Empty places between two groups of pairs."""
LEAST_PLACES = 20
"""So many places make room for the names of groups."""
BINS = 24
SHADES = (0.95, 0.45, 0.1)
"""Of the groups in a histogram."""


@drawing.in_house_style
def pair_errors(
    groups: Sequence[PairGroup], *, quantity: str = "error of distance", what: str = "pairs"
) -> Figure:
    """Errors of every pair or shot, before and after; below, after alone on its own scale."""
    has_after = any(group.after_mm is not None for group in groups)
    has_both = has_after and any(group.before_mm is not None for group in groups)
    figure = drawing.new_figure(96.0 if has_both else 60.0)
    every = figure.subplots(2 if has_both else 1, 1, sharex=True, squeeze=False)[:, 0]
    top, bottom = every[0], every[-1]
    for place, group in _placed(groups):
        _plot(top, place, group.before_mm, group.marker, drawing.BEFORE, "before")
        for axes in every:
            _plot(axes, place, group.after_mm, group.marker, drawing.AFTER, "after")
    for axes in every:
        _divide(axes, groups)
        axes.set_ylabel(f"{quantity}, mm")
    top.set_title("before and after" if has_both else "after" if has_after else "before")
    if has_both:
        bottom.set_title("after, on its own scale")
    bottom.set_xlabel(f"{what}, in the order of the plan")
    drawing.legend_above(figure, top, 2, "outside upper right")
    return figure


@drawing.in_house_style
def histogram(groups: Sequence[PairGroup]) -> Figure:
    """Histogram of the errors, before and after, each on its own scale."""
    figure = drawing.new_figure(56.0)
    left, right = figure.subplots(1, 2)
    for axes, title, colour, errors in (
        (left, "before", drawing.BEFORE, [group.before_mm for group in groups]),
        (right, "after", drawing.AFTER, [group.after_mm for group in groups]),
    ):
        axes.set_title(title)
        axes.set_xlabel("error of distance, mm")
        axes.set_ylabel("pairs")
        _bars(axes, colour, groups, errors)
    drawing.legend_above(figure, right if right.patches else left, len(groups))
    return figure


def _placed(groups: Sequence[PairGroup]) -> Iterator[tuple[Index, PairGroup]]:
    """Places on the axis for each group."""
    start = 1
    for group in groups:
        yield np.arange(start, start + len(group)), group
        start += len(group) + GAP


def _plot(
    axes: Axes, place: Index, errors: Array | None, marker: str, colour: str, label: str
) -> None:
    if errors is None:
        return
    filled = label == "after"
    axes.plot(
        place[: len(errors)],
        errors,
        marker,
        color=colour,
        markerfacecolor=colour if filled else "white",
        markeredgewidth=0.9,
        label=label,
    )


def _divide(axes: Axes, groups: Sequence[PairGroup]) -> None:
    """A line between groups, and each one's name over it."""
    drawing.zero_line(axes)
    axes.set_xticks([])
    for place, group in _placed(groups):
        axes.text(
            float(place[0]) - 0.5,
            1.0,
            group.name,
            transform=axes.get_xaxis_transform(),
            color=drawing.QUIET,
            va="top",
            style="italic",
            in_layout=False,
        )
        if place[0] > 1:
            axes.axvline(float(place[0]) - 0.5 * (GAP + 1), color=drawing.QUIET, linewidth=0.6)
    places = sum(len(group) + GAP for group in groups)
    axes.set_xlim(1 - GAP, max(places, LEAST_PLACES))
    axes.margins(y=0.14)


def _bars(
    axes: Axes, colour: str, groups: Sequence[PairGroup], errors: Sequence[Array | None]
) -> None:
    """Groups stacked, each in its own shade."""
    known = [(g, e) for g, e in zip(groups, errors, strict=True) if e is not None]
    if not known:
        drawing.say_instead(axes, "not measured")
        return
    together = np.concatenate([values for _, values in known])
    edges = np.histogram_bin_edges(together, bins=min(BINS, max(6, len(together) // 4)))
    bottom = np.zeros(len(edges) - 1)
    for (group, values), alpha in zip(known, SHADES, strict=False):
        counts = np.histogram(values, edges)[0]
        axes.bar(
            edges[:-1],
            counts,
            np.diff(edges),
            bottom,
            align="edge",
            facecolor=to_rgba(colour, alpha),
            edgecolor=drawing.INK,
            linewidth=0.4,
            label=group.name,
        )
        bottom += counts
    axes.axvline(0.0, color=drawing.QUIET, linewidth=0.8)
