"""Pictures as files: a plan with its zones and predicted uncertainty, residuals of a fit."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from app.report.drawing import AFTER, BEFORE, INK, QUIET, new_figure, save, show_space
from app.report.figures import draw_errors
from app.report.result_tables import PairGroup, error_group
from campaigns.arrays import Array
from campaigns.design.restricted_space import UNRESTRICTED, Disc, RestrictedSpace, Zone
from campaigns.identification.result import IdentificationResult
from campaigns.planning.forecast import Forecast
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import poses_of
from campaigns.shots.shot_sets import ShotSet

POSES_MM, STD_MM = 88.0, 68.0
"""Heights of the two parts of a plan's picture."""
MOST_BARS = 12
"""Parameters of each unit that are drawn, those with the largest σ."""
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
    """Draw a plan and its predicted uncertainty; .svg, .png or .pdf. Raise `WriteFailed`."""
    heights = [POSES_MM, STD_MM] if forecast.std else [POSES_MM]
    figure = new_figure(sum(heights))
    parts = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    _draw_poses(parts[0], shots, space)
    if forecast.std:
        _draw_std(parts[1], forecast)
    save(figure, path)


def plot_residuals(path: Path, found: IdentificationResult) -> None:
    """Draw what was fitted and the hold-out pairs, before and after; raise `WriteFailed`."""
    of_pairs = found.fitted is not None and found.fitted.of == "pairs"
    fitted = "fitted pairs" if of_pairs else "fitted shots, length of the error"
    tables = ((fitted, "o", found.fitted), ("hold-out pairs, error of distance", "D", found.unseen))
    groups: list[PairGroup] = [
        error_group(name, marker, table.before, table.after)
        for name, marker, table in tables
        if table is not None
    ]
    quantity = "error of distance, mm" if of_pairs else "error, mm"
    figure = new_figure(110.0)
    both, after = figure.subplots(2, 1)
    draw_errors(both, groups, ("before", "after"))
    draw_errors(after, groups, ("after",))
    both.set(title="before and after", ylabel=quantity)
    after.set(title="after, on its own scale", ylabel=quantity)
    after.set_xlabel(f"{'pairs' if of_pairs else 'shots and pairs'}, in the order of the plan")
    figure.legend(*both.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    save(figure, path)


def _draw_poses(
    figure: FigureBase, shots: Sequence[PlannedShot], restricted: RestrictedSpace
) -> None:
    """Draw the poses by what they are for, and the zones, in space and from above."""
    poses_mm = poses_of(shots)[:, :3]
    space: Any = figure.add_subplot(1, 2, 1, projection="3d", computed_zorder=False)
    above = figure.add_subplot(1, 2, 2)
    reach_mm = restricted.plate_radius_mm + restricted.margin_mm
    room_mm = reach_mm + 0.1 * max(float(np.ptp(poses_mm, axis=0).max()), 1.0)
    low, high = poses_mm.min(axis=0), poses_mm.max(axis=0)
    shown = [poses_mm]
    for zone in restricted.zones:
        edges = _edges(zone, low - room_mm, high + room_mm)
        if edges is not None:
            _draw_zone(space, above, zone, edges)
            shown += [*edges]
    corners = np.concatenate(shown)
    show_space(space, corners.min(axis=0), corners.max(axis=0))
    for purpose, (marker, colour) in MARKERS.items():
        rows = [row for row, shot in enumerate(shots) if shot.purpose is purpose]
        if rows:
            space.plot(*poses_mm[rows].T, marker, color=colour)
            above.plot(*poses_mm[rows, :2].T, marker, color=colour, label=purpose.value)
    space.set_title("in the base frame, mm")
    kept_off = f", walls {reach_mm:g} mm off" if restricted.is_restricted else ""
    above.set(xlabel="x, mm", ylabel="y, mm", aspect="equal", title=f"from above{kept_off}")
    handles, labels = above.get_legend_handles_labels()
    by_name = dict(zip(labels, handles, strict=True))
    figure.legend(by_name.values(), by_name.keys(), loc="outside upper left", ncols=5)


def _edges(zone: Zone, low: Array, high: Array) -> Array | None:
    """Return lower and upper edge (2, K, 3) of a zone within the corners (3,) of the picture.

    None: the zone is outside of it.
    """
    ends = np.array([*zone.footprint.bounds_mm(), zone.z_mm])
    lowest, highest = np.maximum(ends[:, 0], low), np.minimum(ends[:, 1], high)
    if (lowest >= highest).any():
        return None
    if isinstance(zone.footprint, Disc):
        turn = np.linspace(0.0, 2.0 * np.pi, 49)
        circle = zone.footprint.radius_mm * np.column_stack([np.cos(turn), np.sin(turn)])
        edge = np.clip(zone.footprint.centre_mm + circle, low[:2], high[:2])
    else:
        (x0, y0, _), (x1, y1, _) = lowest, highest
        edge = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])
    return np.stack(
        [np.column_stack([edge, np.full(len(edge), z)]) for z in (lowest[2], highest[2])]
    )


def _draw_zone(space: Any, above: Axes, zone: Zone, edges: Array) -> None:
    """Draw a zone to keep out of filled, one to keep in dashed."""
    colour, line = (INK, "--") if zone.keeps_in else (QUIET, "-")
    uprights = edges[:, :: max(1, (edges.shape[1] - 1) // 4)].transpose(1, 0, 2)
    for part in (*edges, *uprights):
        space.plot(*part.T, line, color=colour, linewidth=0.7, zorder=1.2)
    if np.isfinite(zone.footprint.bounds_mm()).any():
        label = "keep in" if zone.keeps_in else "keep out"
        above.plot(*edges[0, :, :2].T, line, color=colour, linewidth=0.9, label=label)
        if not zone.keeps_in:
            above.fill(*edges[0, :, :2].T, color=INK, alpha=0.12, linewidth=0.0)


def _draw_std(figure: FigureBase, forecast: Forecast) -> None:
    """Draw the largest σ of each unit as bars, each unit with an axis of its own."""
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
