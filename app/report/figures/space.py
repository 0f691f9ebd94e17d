"""Points in space on paper: a parallel projection with a box that says where they are, in mm."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from app.report.figures.drawing import GRID, INK, QUIET
from campaigns.arrays import Array

AZIMUTH, ELEVATION = np.radians(-58.0), np.radians(22.0)
"""Where it is looked from: x to the right, y away, z up."""
RIGHT = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
UP = np.array(
    [
        -np.sin(ELEVATION) * np.cos(AZIMUTH),
        -np.sin(ELEVATION) * np.sin(AZIMUTH),
        np.cos(ELEVATION),
    ]
)
INTERVALS = 4
LABEL_SIZE = 6.5
ROOM = 0.06
"""Between the outermost points and the box, in the points' extent."""
NUMBERS_OUT, LETTERS_OUT = 0.05, 0.22
"""Distance of numbers and letters from the box, in its size."""


def flat(vectors: Array) -> Array:
    """Vectors (N, 3) as seen, (N, 2)."""
    return np.column_stack([vectors @ RIGHT, vectors @ UP])


def draw_box(axes: Axes, points: Array) -> None:
    """Floor and two back walls about points (N, 3), with their numbers, on otherwise bare axes."""
    room = ROOM * max(float(np.ptp(points, axis=0).max()), 1.0)
    low, high = points.min(axis=0) - room, points.max(axis=0) + room
    ticks = tuple(_ticks(*ends) for ends in zip(low, high, strict=True))
    axes.set_axis_off()
    axes.set_aspect("equal")
    for line in (*_frame(low, high), *_grid(low, high, ticks)):
        axes.plot(*flat(line).T, color=GRID, linewidth=0.5, zorder=0.5)
    for edge in _front_edges(low, high, ticks):
        _label(axes, edge)


@dataclass(frozen=True, slots=True, eq=False)
class _Edge:
    """An edge of the box that carries the numbers of an axis."""

    name: str
    numbers: Array
    places: Array
    """Of the numbers, (K, 3)."""
    letter: Array
    """The place of the axis's letter, (1, 3)."""
    across: Literal["left", "right"]
    upright: Literal["top", "center"]


def _ticks(low: float, high: float) -> Array:
    """Round numbers inside the interval."""
    values = np.asarray(MaxNLocator(INTERVALS).tick_values(low, high))
    return values[(values >= low) & (values <= high)]


def _frame(low: Array, high: Array) -> Iterator[Array]:
    """The outlines of floor and back walls, each as corners in turn."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    yield np.array([[x0, y0, z0], [x1, y0, z0], [x1, y1, z0], [x0, y1, z0], [x0, y0, z0]])
    yield np.array([[x0, y0, z0], [x0, y0, z1], [x0, y1, z1], [x1, y1, z1], [x1, y1, z0]])
    yield np.array([[x0, y1, z0], [x0, y1, z1]])


def _grid(low: Array, high: Array, ticks: tuple[Array, ...]) -> Iterator[Array]:
    """A bent line a tick: over the floor and up the wall behind, or round the two walls."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    for x in ticks[0]:
        yield np.array([[x, y0, z0], [x, y1, z0], [x, y1, z1]])
    for y in ticks[1]:
        yield np.array([[x1, y, z0], [x0, y, z0], [x0, y, z1]])
    for z in ticks[2]:
        yield np.array([[x0, y0, z], [x0, y1, z], [x1, y1, z]])


def _front_edges(low: Array, high: Array, ticks: tuple[Array, ...]) -> Iterator[_Edge]:
    (x0, y0, z0), (x1, _, _) = low, high
    (xs, ys, zs), (xm, ym, zm) = ticks, 0.5 * (low + high)
    near, far = (out * float((high - low).max()) for out in (NUMBERS_OUT, LETTERS_OUT))
    along_x = np.array([[x, y0 - near, z0] for x in xs])
    along_y = np.array([[x1 + near, y, z0] for y in ys])
    along_z = np.array([[x0 - near, y0, z] for z in zs])
    yield _Edge("x", xs, along_x, np.array([[xm, y0 - far, z0]]), "right", "top")
    yield _Edge("y", ys, along_y, np.array([[x1 + far, ym, z0]]), "left", "top")
    yield _Edge("z", zs, along_z, np.array([[x0 - far, y0, zm]]), "right", "center")


def _label(axes: Axes, edge: _Edge) -> None:
    for (right, up), number in zip(flat(edge.places).tolist(), edge.numbers, strict=True):
        axes.text(
            right,
            up,
            f"{number:.0f}".replace("-", "−"),
            color=INK,
            fontsize=LABEL_SIZE,
            ha=edge.across,
            va=edge.upright,
        )
    right, up = flat(edge.letter)[0].tolist()
    axes.text(right, up, edge.name, color=QUIET, style="italic", ha=edge.across, va="center")
