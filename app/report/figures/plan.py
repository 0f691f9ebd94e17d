"""Plan: where it measures, how well parameters will be known, what more shots would tell."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.ticker import LogLocator, MaxNLocator, StrMethodFormatter

from app.report.figures.drawing import in_house_style, legend_above, new_figure
from app.report.figures.picture import AFTER, AZIMUTH_DEG, BEFORE, ELEVATION_DEG, GRID, INK, QUIET
from app.report.figures.workspace import ROUND_FACTORS
from app.report.figures.zones import draw_zones, outlines
from campaigns.arrays import Array
from campaigns.design.restricted_space import RestrictedSpace
from campaigns.estimation.information import Uncertainty
from campaigns.planning.predicted_uncertainty import Forecast
from campaigns.shots.shot_sets import ShotSet

POSES_MM, STD_MM, CURVE_MM = 88.0, 58.0, 58.0
"""Heights of the parts."""
MOST_TICKS = 12
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
    poses: Array,
    purposes: tuple[ShotSet, ...],
    forecast: Forecast,
    curve: Sequence[Forecast],
    space: RestrictedSpace,
) -> Figure:
    """Poses (N, t) by what they are for, and zones; σ of parameters, if known; the curve."""
    predicted, heights = forecast.predicted, [POSES_MM]
    heights += [STD_MM] if predicted.full_rank else []
    heights += [CURVE_MM] if curve else []
    figure = new_figure(sum(heights))
    parts = list(figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False).flat)
    _draw_poses(parts.pop(0), poses, purposes, space)
    if predicted.full_rank:
        _draw_std(parts.pop(0), predicted)
    if curve:
        _draw_curve(parts.pop(0), curve, forecast.shots)
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


def _draw_std(figure: FigureBase, predicted: Uncertainty) -> None:
    """Bars, lengths and angles each with an axis of their own."""
    kinds: dict[str, dict[str, float]] = {"_mm": {}, "_deg": {}}
    for (name, std), unit in zip(predicted.std().items(), predicted.units, strict=True):
        kinds[f"_{unit}"][name] = std
    shown = {unit: values for unit, values in kinds.items() if values}
    widths = [max(len(values), 4) for values in shown.values()]
    every = figure.subplots(1, len(shown), width_ratios=widths, squeeze=False)[0]
    for axes, (unit, values) in zip(every, shown.items(), strict=True):
        _draw_bars(axes, {name.removesuffix(unit): value for name, value in values.items()})
        axes.set_title(f"predicted σ, {unit[1:]}")


def _draw_bars(axes: Axes, values: Mapping[str, float]) -> None:
    axes.bar(range(len(values)), list(values.values()), color=AFTER, width=0.7)
    axes.set_xticks(range(len(values)), list(values), rotation=90)
    axes.grid(visible=False, axis="x")


def _draw_curve(figure: FigureBase, curve: Sequence[Forecast], own: int) -> None:
    """By number of shots, this plan's own marked, both axes by powers."""
    lengths, angles = figure.subplots(1, 2)
    shots = [at.shots for at in curve]
    worst = [at.predicted.largest("mm") for at in curve]
    lengths.plot(shots, worst, "o-", color=AFTER, label="worst length")
    positions = [at.position_std_mm.mean() for at in curve]
    lengths.plot(shots, positions, "D-", color=BEFORE, label="position, mean")
    worst_deg = [at.predicted.largest("deg") for at in curve]
    angles.plot(shots, worst_deg, "o-", color=AFTER, label="worst angle")
    for axes, unit in ((lengths, "mm"), (angles, "deg")):
        axes.axvline(own, color=QUIET, linewidth=0.8, linestyle="--", label="this plan", zorder=1.5)
        axes.set(xscale="log", yscale="log", xlabel="shots to identify from", ylabel=f"σ, {unit}")
        axes.set_xticks(shots, [str(count) for count in shots])
        axes.yaxis.set_major_locator(LogLocator(subs=ROUND_FACTORS, numticks=MOST_TICKS))
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.minorticks_off()
        axes.legend(loc="upper right", frameon=True, facecolor="white", edgecolor="none")
