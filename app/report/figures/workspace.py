"""Pictures in the workspace: by how much the model misses, and where."""

from itertools import chain

import numpy as np

from app.report.figures.picture import (
    AFTER,
    BEFORE,
    INK,
    QUIET,
    Look,
    Panel,
    Picture,
    Space,
    arrow,
    span,
)
from campaigns.arrays import Array, Mask
from campaigns.evaluation.summary import binned_medians

ARROW_MM = 130.0
"""Length at which the longest arrow is drawn."""
LEAN_ARROW_MM = 90.0
ROUND_FACTORS = (1, 2, 5)
BINS = 6
COORDINATES = ("x, mm", "y, mm", "z, mm", "θ, °")
MEDIAN = ("median of each sixth", Look(INK, dash=""))
DOT = Look(QUIET, "o", size=0.6)


def error_arrows(poses: Array, before_mm: Array | None, after_mm: Array | None) -> Picture:
    """Measured minus modelled position at each pose, each panel with its own magnification."""
    picture = Picture(76.0)
    stages = (("before", BEFORE, before_mm), ("after", AFTER, after_mm))
    panels = picture.panels(1, 2, legend=False, foot=6.0)[0]
    for panel, (name, colour, errors) in zip(panels, stages, strict=True):
        space = Space(panel, poses[:, :3])
        if errors is None:
            panel.title(f"{name}: not known")
            continue
        factor = magnification(errors)
        starts, ends = space.seen(poses[:, :3]), space.seen(poses[:, :3] + factor * errors)
        picture.marks(starts, DOT)
        for start, end in zip(starts, ends, strict=True):
            arrow(picture, start, end, colour)
        panel.title(f"{name}: arrows {factor:g} times the error")
    return picture


def errors_against_position(poses: Array, errors_mm: Array, fitted: Mask) -> Picture:
    """Length of the error of position, against each coordinate of the pose."""
    picture = Picture(98.0)
    size = np.linalg.norm(errors_mm, axis=1)
    values = [*poses[:, :3].T, *np.degrees(poses[:, 3:]).T]
    every = [*chain.from_iterable(picture.panels(2, 2, title=False))]
    kinds = (
        ("fitted", Look(AFTER, "o"), fitted),
        ("hold-out", Look(AFTER, "D", filled=False), ~fitted),
    )
    for place, (panel, column, name) in enumerate(zip(every, values, COORDINATES, strict=False)):
        upwards = "" if place % 2 else "error of position, mm"
        panel.axes(span(column), span(size, zero=True), names=(name, upwards))
        panel.level()
        for _, look, rows in kinds:
            panel.plot(column[rows], size[rows], look)
        _medians(panel, column, size)
    picture.legend([*((name, look) for name, look, _ in kinds), MEDIAN])
    return picture


def plate_tilt(poses: Array, tilt_rad: Array) -> Picture:
    """How the tool leans: from above as arrows to where its lower end goes, and by distance."""
    picture = Picture(76.0)
    above, along = picture.panels(1, 2)[0]
    lean_mrad = 1e3 * np.stack([-tilt_rad[:, 1], tilt_rad[:, 0]], axis=1)
    size = np.linalg.norm(lean_mrad, axis=1)
    arrows = (LEAN_ARROW_MM / float(size.max())) * lean_mrad
    (x, y), (u, v) = poses[:, :2].T, arrows.T
    above.axes(span(x, x + u), span(y, y + v), names=("x, mm", "y, mm"), square=True)
    above.plot(x, y, DOT)
    above.arrows(x, y, u, v, AFTER)
    above.title(f"from above: the longest is {size.max():.2f} mrad")
    away_mm = np.linalg.norm(poses[:, :2] - poses[:, :2].mean(axis=0), axis=1)
    high = (0.0, span(size, zero=True)[1])
    along.axes(span(away_mm), high, names=("distance from the middle, mm", "lean, mrad"))
    along.plot(away_mm, size, Look(AFTER, "o"))
    _medians(along, away_mm, size)
    picture.legend([MEDIAN])
    return picture


def _medians(panel: Panel, values: Array, sizes: Array) -> None:
    panel.plot(*binned_medians(values, sizes, BINS), MEDIAN[1])


def magnification(errors_mm: Array) -> float:
    """Round factor that makes the longest of vectors (N, 3) about `ARROW_MM` long."""
    longest = float(np.linalg.norm(errors_mm, axis=1).max())
    if longest == 0.0:
        return 1.0
    wanted = ARROW_MM / longest
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(f * power for f in ROUND_FACTORS if f * power <= wanted))
