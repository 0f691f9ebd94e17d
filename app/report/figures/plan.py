"""Plan: where it measures, and the uncertainty that its shots will give."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.ticker import MaxNLocator

from app.report.figures.drawing import in_house_style, legend_above, new_figure
from app.report.figures.picture import AFTER, AZIMUTH_DEG, BEFORE, ELEVATION_DEG, GRID, INK, QUIET
from app.report.figures.zones import draw_zones, outlines
from campaigns.arrays import Array
from campaigns.design.restricted_space import RestrictedSpace
from campaigns.planning.forecast import Forecast
from campaigns.shots.shot_sets import ShotSet

POSES_MM, STD_MM = 88.0, 68.0
"""Heights of the parts."""
MOST_BARS = 12
"""Parameters of each unit that are drawn, those with the largest σ."""
INTERVALS = 4
LABEL_SIZE = 6.5
LABEL_PAD = -6.0
ZOOM = 0.98
BARE = (0.0, 0.0, 0.0, 0.0)
MARKERS: Mapping[ShotSet, tuple[str, str]] = {
    ShotSet.IDENTIFICATION: ("o", AFTER),
    ShotSet.VALIDATION: ("D", BEFORE),
    ShotSet.DRIFT: ("*", INK),
}


@in_house_style
def plan_picture(
    poses: Array, purposes: tuple[ShotSet, ...], forecast: Forecast, space: RestrictedSpace
) -> Figure:
    """Draw poses (N, t) by their purpose, with zones, and below them the σ of parameters."""
    heights = [POSES_MM, STD_MM] if forecast.std else [POSES_MM]
    figure = new_figure(sum(heights))
    parts = list(figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False).flat)
    _draw_poses(parts[0], poses, purposes, space)
    if forecast.std:
        _draw_std(parts[1], forecast)
    return figure


def _draw_poses(
    figure: FigureBase, poses: Array, purposes: tuple[ShotSet, ...], restricted: RestrictedSpace
) -> None:
    """Poses (N, t) of a plan by what they are for, and zones, in space and from above."""
    space, above = axes_in_space(figure, (1, 2, 1)), figure.add_subplot(1, 2, 2)
    zones = outlines(restricted, poses[:, :3])
    walls = [loop for zone in zones for loop in zone.loops]
    one_scale(space, np.vstack([poses[:, :3], *walls]))
    draw_zones(space, above, zones)
    for purpose, (marker, colour) in MARKERS.items():
        rows = [row for row, kind in enumerate(purposes) if kind is purpose]
        if rows:
            space.plot(*poses[rows, :3].T, marker, color=colour)
            above.plot(*poses[rows, :2].T, marker, color=colour, label=purpose.value)
    space.set_title("in the base frame, mm")
    reach_mm = restricted.plate_radius_mm + restricted.margin_mm
    kept_off = f", walls {reach_mm:g} mm off" if restricted.is_restricted else ""
    above.set(xlabel="x, mm", ylabel="y, mm", aspect="equal", title=f"from above{kept_off}")
    legend_above(figure, above, len(MARKERS) + 2)


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


def _draw_std(figure: FigureBase, forecast: Forecast) -> None:
    """Draw the largest σ of each unit as bars, each unit with an axis of its own."""
    by_unit: dict[str, dict[str, float]] = {}
    for name, std in sorted(forecast.std.items(), key=lambda row: -row[1]):
        values = by_unit.setdefault(forecast.units[name], {})
        if len(values) < MOST_BARS:
            values[name] = std
    widths = [max(len(values), 4) for values in by_unit.values()]
    panels = figure.subplots(1, len(by_unit), width_ratios=widths, squeeze=False)[0]
    for axes, (unit, values) in zip(panels, by_unit.items(), strict=True):
        _draw_bars(axes, {name.removesuffix(f"_{unit}"): std for name, std in values.items()})
        axes.set_title(f"σ, {unit}")


def _draw_bars(axes: Axes, values: Mapping[str, float]) -> None:
    axes.bar(range(len(values)), list(values.values()), color=AFTER, width=0.7)
    axes.set_xticks(range(len(values)), list(values), rotation=90)
    axes.grid(visible=False, axis="x")
