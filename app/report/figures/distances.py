"""Errors of distances: pair by pair (the paper's Fig. 8), as histogram, and over the workspace."""

from collections.abc import Iterator, Sequence

import numpy as np

from app.report.figures.picture import AFTER, BEFORE, QUIET, Look, Panel, Picture, Range, span
from app.report.groups import PairGroup
from campaigns.arrays import Array, Index

GAP = 3
"""Empty places between two groups of pairs."""
LEAST_PLACES = 20
"""So many places make room for the names of groups."""
BINS = 24
SHADES = (0.95, 0.45, 0.1)
"""Of the groups in a histogram."""
HEADROOM = 0.14


def pair_errors(
    groups: Sequence[PairGroup], *, quantity: str = "error of distance", what: str = "pairs"
) -> Picture:
    """Errors of every pair or shot, before and after; below, after alone on its own scale."""
    before, after = [g.before_mm for g in groups], [g.after_mm for g in groups]
    has_after = any(each is not None for each in after)
    has_both = has_after and any(each is not None for each in before)
    picture = Picture(96.0 if has_both else 60.0)
    panels = [row[0] for row in picture.panels(1 + has_both, 1, between=6.0, foot=16.0)]
    first = "before and after" if has_both else "after" if has_after else "before"
    stages = (("before", BEFORE, before), ("after", AFTER, after))
    for place, panel in enumerate(panels):
        shown = stages[place:]
        _axes(panel, groups, [mm for _, _, every in shown for mm in every], f"{quantity}, mm")
        panel.title("after, on its own scale" if place else first)
        for stage, colour, every in shown:
            for (at, group), mm in zip(_placed(groups), every, strict=True):
                if mm is not None:
                    look = Look(colour, group.marker, filled=stage == "after")
                    panel.plot(at[: len(mm)].astype(float), mm, look, _names(group, mm, what))
    last = panels[-1]
    middle = last.left + last.width / 2
    foot = f"{what}, in the order of the plan"
    picture.text(middle, last.top + last.height + 12.0, foot, anchor="middle")
    names = [
        (stage, Look(colour, groups[0].marker, filled=stage == "after"))
        for stage, colour, every in stages
        if any(mm is not None for mm in every)
    ]
    picture.legend(names, right=True)
    return picture


def histogram(groups: Sequence[PairGroup]) -> Picture:
    """Histogram of the errors, before and after, each on its own scale."""
    picture = Picture(56.0)
    stages = (
        ("before", BEFORE, [group.before_mm for group in groups]),
        ("after", AFTER, [group.after_mm for group in groups]),
    )
    for panel, (title, colour, errors) in zip(picture.panels(1, 2)[0], stages, strict=True):
        _bars(panel, colour, errors)
        panel.title(title)
    told = next(
        (colour for _, colour, every in stages[::-1] if any(e is not None for e in every)), AFTER
    )
    picture.shades((g.name, told, alpha) for g, alpha in zip(groups, SHADES, strict=False))
    return picture


def _names(group: PairGroup, errors: Array, what: str) -> list[str]:
    """What stands under the cursor: number and error of each shot or pair."""
    one = what.removesuffix("s")
    return [f"{one} {n}: {mm:.3f} mm" for n, mm in zip(group.numbers, errors, strict=False)]


def _placed(groups: Sequence[PairGroup]) -> Iterator[tuple[Index, PairGroup]]:
    """Places on the axis for each group."""
    start = 1
    for group in groups:
        yield np.arange(start, start + len(group)), group
        start += len(group) + GAP


def _axes(
    panel: Panel, groups: Sequence[PairGroup], errors: Sequence[Array | None], name: str
) -> None:
    """Axes with a line between groups, and each one's name over it."""
    places = sum(len(group) + GAP for group in groups)
    wide: Range = (1.0 - GAP, float(max(places, LEAST_PLACES)))
    panel.axes(wide, span(*errors, room=HEADROOM, zero=True), names=("", name), x_ticks=False)
    panel.level()
    for place, group in _placed(groups):
        x, _ = panel.place(float(place[0]) - 0.5, 0.0)
        quiet = f'fill="{QUIET}" font-style="italic"'
        panel.picture.text(x, panel.top + 6.0, group.name, style=quiet)
        if place[0] > 1:
            panel.upright(float(place[0]) - 0.5 * (GAP + 1), 0.6)


def _bars(panel: Panel, colour: str, errors: Sequence[Array | None]) -> None:
    """Groups stacked, each in its own shade."""
    names = ("error of distance, mm", "pairs")
    known = [(mm, alpha) for mm, alpha in zip(errors, SHADES, strict=False) if mm is not None]
    if not known:
        panel.axes((0.0, 1.0), (0.0, 1.0), x_numbers=False, y_numbers=False, names=names)
        panel.instead("not measured")
        return
    together = np.concatenate([values for values, _ in known])
    edges = np.histogram_bin_edges(together, bins=min(BINS, max(6, len(together) // 4)))
    counts = [np.histogram(values, edges)[0] for values, _ in known]
    top = np.cumsum(counts, axis=0)
    panel.axes(span(edges), (0.0, 1.05 * float(top.max())), names=names)
    for own, above, (_, alpha) in zip(counts, top, known, strict=True):
        for n, height in zip(np.flatnonzero(own), above[own > 0], strict=True):
            panel.bar((edges[n], edges[n + 1]), (height - own[n], height), colour, alpha)
    panel.upright(0.0)
