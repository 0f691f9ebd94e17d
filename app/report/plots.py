"""Picture of a plan as a file: its poses, the zones, and the predicted uncertainty.

The upper part shows where the shots are, from above and from the side, with the zones of the
restricted space. The lower part shows the σ that the plan's forecast predicts for each parameter.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.patches import Circle, Patch, Rectangle

from app.report.drawing import AFTER, BEFORE, INK, QUIET, new_figure, save
from campaigns.design.restricted_space import UNRESTRICTED, Disc, RestrictedSpace, Zone
from campaigns.planning.forecast import Forecast
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import poses_of
from campaigns.shots.shot_sets import ShotSet

POSES_MM, STD_MM = 88.0, 68.0
"""Heights of the two parts of a plan's picture: poses, and σ of parameters."""
MOST_BARS = 12
"""Largest number of parameters of a unit that are drawn, those with the largest σ."""
MARKERS: Mapping[ShotSet, tuple[str, str]] = {
    ShotSet.IDENTIFICATION: ("o", AFTER),
    ShotSet.VALIDATION: ("D", BEFORE),
    ShotSet.DRIFT: ("*", INK),
}


def plot_plan(
    path: Path,
    shots: Sequence[PlannedShot],
    forecast: Forecast,
    space: RestrictedSpace = UNRESTRICTED,
) -> None:
    """Draw a plan and its predicted uncertainty as .svg, .png or .pdf; raise `WriteFailed`."""
    heights = [POSES_MM, STD_MM] if forecast.std else [POSES_MM]
    figure = new_figure(sum(heights))
    parts = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    _draw_poses(parts[0], shots, space)
    if forecast.std:
        _draw_std(parts[1], forecast)
    save(figure, path)


def _draw_poses(figure: FigureBase, shots: Sequence[PlannedShot], space: RestrictedSpace) -> None:
    """Draw the poses by their purpose, and the zones, from above and from the side."""
    poses_mm = poses_of(shots)[:, :3]
    above, aside = figure.subplots(1, 2)
    reach_mm = space.plate_radius_mm + space.margin_mm
    walls = f", walls {reach_mm:g} mm off" if space.is_restricted else ""
    for axes, view, side in ((above, f"from above{walls}", 1), (aside, "from the side", 2)):
        for purpose, (marker, colour) in MARKERS.items():
            rows = [row for row, shot in enumerate(shots) if shot.purpose is purpose]
            if rows:
                places = poses_mm[rows][:, [0, side]].T
                axes.plot(*places, marker, color=colour, label=purpose.value)
        axes.set(xlabel="x, mm", ylabel=f"{'xyz'[side]}, mm", title=view)
        # the shots give the scale: zones may be much larger or endless, and are cut at the edge
        axes.autoscale(enable=False)
        for zone in space.zones:
            _draw_zone(axes, zone, side)
        axes.set_aspect("equal", adjustable="datalim")
    handles, labels = above.get_legend_handles_labels()
    by_name = dict(zip(labels, handles, strict=True))
    figure.legend(by_name.values(), by_name.keys(), loc="outside upper left", ncols=5)


def _draw_zone(axes: Axes, zone: Zone, side: int) -> None:
    """Draw a zone to keep out of filled, a zone to keep in dashed."""
    bounds_mm = np.array([*zone.footprint.bounds_mm(), zone.z_mm])[[0, side]]
    if not np.isfinite(bounds_mm).any():
        return  # this view does not show the zone's walls
    bounds_mm = np.clip(bounds_mm, -1e6, 1e6)  # an endless side ends a kilometre away
    patch: Patch = Rectangle(tuple(bounds_mm[:, 0]), *np.ptp(bounds_mm, axis=1))
    if side == 1 and isinstance(zone.footprint, Disc):
        patch = Circle(zone.footprint.centre_mm, zone.footprint.radius_mm)
    if zone.keeps_in:
        patch.set(fill=False, edgecolor=INK, linestyle="--", label="keep in")
    else:
        patch.set(facecolor=QUIET, alpha=0.2, label="keep out")
    axes.add_patch(patch)


def _draw_std(figure: FigureBase, forecast: Forecast) -> None:
    """Draw the largest σ of each unit as bars, each unit with an axis of its own."""
    # mm, deg and ppm have no common scale; the width of a panel follows its number of bars
    by_unit: dict[str, dict[str, float]] = {}
    for name, std in sorted(forecast.std.items(), key=lambda row: -row[1]):
        values = by_unit.setdefault(forecast.units[name], {})
        if len(values) < MOST_BARS:
            values[name.removesuffix(f"_{forecast.units[name]}")] = std
    widths = [max(len(values), 4) for values in by_unit.values()]
    panels = figure.subplots(1, len(by_unit), width_ratios=widths, squeeze=False)[0]
    for axes, (unit, values) in zip(panels, by_unit.items(), strict=True):
        axes.bar(range(len(values)), list(values.values()), color=AFTER, width=0.7)
        axes.set_xticks(range(len(values)), list(values), rotation=90)
        axes.grid(visible=False, axis="x")
        axes.set_title(f"σ, {unit}")
