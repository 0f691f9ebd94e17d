"""Points in space on paper: axes in space, looked at from one side, to one scale, in mm."""

from typing import Any

import numpy as np
from matplotlib.figure import FigureBase
from matplotlib.ticker import MaxNLocator

from app.report.figures.picture import GRID, QUIET
from campaigns.arrays import Array

AZIMUTH_DEG, ELEVATION_DEG = -58.0, 22.0
"""Where it is looked from: x to the right, y away, z up."""
INTERVALS = 4
LABEL_SIZE = 6.5
LABEL_PAD = -6.0
ZOOM = 0.98
BARE = (0.0, 0.0, 0.0, 0.0)


def axes_in_space(figure: FigureBase, place: tuple[int, int, int]) -> Any:
    """Axes at a place of the figure, such as (1, 2, 1). Any: mplot3d has no types."""
    axes: Any = figure.add_subplot(
        *place, projection="3d", proj_type="ortho", computed_zorder=False
    )
    axes.view_init(elev=ELEVATION_DEG, azim=AZIMUTH_DEG)
    for name, axis in (("x", axes.xaxis), ("y", axes.yaxis), ("z", axes.zaxis)):
        axis.set_pane_color(BARE)
        axis.line.set_color(GRID)
        axis.set_major_locator(MaxNLocator(INTERVALS))
        axis.set_label_text(name, style="italic", color=QUIET)
        axis.labelpad = LABEL_PAD
        axis.set_tick_params(labelsize=LABEL_SIZE, pad=-2)
    axes.zaxis.set_ticks_position("upper")
    axes.zaxis.set_label_position("upper")
    return axes


def one_scale(axes: Any, points: Array) -> None:
    """Show points (N, 3) and no more, all directions to the same scale."""
    low, high = points.min(axis=0), points.max(axis=0)
    size = np.maximum(high - low, 1.0)
    axes.set(xlim=(low[0], low[0] + size[0]), ylim=(low[1], low[1] + size[1]))
    axes.set_zlim(low[2], low[2] + size[2])
    axes.set_box_aspect(size, zoom=ZOOM)
