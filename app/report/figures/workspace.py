"""Pictures in the workspace: where was measured, and by how much the model misses there."""

import json
from collections.abc import Mapping

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure, FigureBase

from app.report.figures import drawing
from app.report.figures.space import axes_in_space, one_scale
from app.report.figures.zones import draw_zones, outlines
from campaigns.arrays import Array, Mask
from campaigns.design.restricted_space import RestrictedSpace
from campaigns.evaluation.model_errors import PositionErrors
from campaigns.evaluation.summary import binned_medians
from campaigns.shots.shot_sets import ShotSet

ARROW_MM = 130.0
"""Length at which the longest arrow is drawn."""
LEAN_ARROW_MM = 90.0
ROUND_FACTORS = (1, 2, 5)
BINS = 6
COORDINATES = ("x, mm", "y, mm", "z, mm", "θ, °")
MARKERS: Mapping[ShotSet, tuple[str, str]] = {
    ShotSet.IDENTIFICATION: ("o", drawing.AFTER),
    ShotSet.VALIDATION: ("D", drawing.BEFORE),
    ShotSet.DRIFT: ("*", drawing.INK),
}


def draw_poses(
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
    drawing.legend_above(figure, above, len(MARKERS) + 2)


@drawing.in_house_style
def error_arrows(poses: Array, before_mm: Array | None, after_mm: Array | None) -> Figure:
    """Measured minus modelled position at each pose, each panel with its own magnification."""
    figure = drawing.new_figure(76.0)
    panels = (("before", drawing.BEFORE, before_mm), ("after", drawing.AFTER, after_mm))
    for column, (name, colour, errors) in enumerate(panels, 1):
        space = axes_in_space(figure, (1, 2, column))
        one_scale(space, poses[:, :3])
        if errors is None:
            space.set_title(f"{name}: not known")
            continue
        factor = magnification(errors)
        place, arrow = poses[:, :3].T, (factor * errors).T
        space.plot(*place, ".", color=drawing.QUIET, markersize=2.0)
        space.quiver(*place, *arrow, color=colour, arrow_length_ratio=0.25, linewidth=0.8)
        space.set_title(f"{name}: arrows {factor:g} times the error")
    return figure


@drawing.in_house_style
def errors_against_position(poses: Array, errors_mm: Array, fitted: Mask) -> Figure:
    """Length of the error of position, against each coordinate of the pose."""
    figure = drawing.new_figure(98.0)
    size = np.linalg.norm(errors_mm, axis=1)
    values = [*poses[:, :3].T, *np.degrees(poses[:, 3:]).T]
    every = figure.subplots(2, 2, sharey=True).ravel()
    for axes in every[len(values) :]:
        axes.set_axis_off()
    for axes, column, name in zip(every, values, COORDINATES, strict=False):
        axes.plot(column[fitted], size[fitted], "o", color=drawing.AFTER, label="fitted")
        axes.plot(
            column[~fitted], size[~fitted], "D", color=drawing.AFTER, mfc="white", label="unseen"
        )
        axes.plot(
            *binned_medians(column, size, BINS), color=drawing.INK, label="median of each sixth"
        )
        axes.set_xlabel(name)
        drawing.zero_line(axes)
    for axes in every[::2]:
        axes.set_ylabel("error of position, mm")
    drawing.legend_above(figure, every[0], 3)
    return figure


@drawing.in_house_style
def plate_tilt(poses: Array, tilt_rad: Array) -> Figure:
    """How the tool leans: from above as arrows to where its lower end goes, and by distance."""
    figure = drawing.new_figure(76.0)
    above, along = figure.subplots(1, 2)
    lean_mrad = 1e3 * np.stack([-tilt_rad[:, 1], tilt_rad[:, 0]], axis=1)
    size = np.linalg.norm(lean_mrad, axis=1)
    arrows = (LEAN_ARROW_MM / float(size.max())) * lean_mrad
    above.plot(*poses[:, :2].T, ".", color=drawing.QUIET, markersize=2.0)
    above.quiver(
        *poses[:, :2].T,
        *arrows.T,
        color=drawing.AFTER,
        angles="xy",
        scale_units="xy",
        scale=1.0,
        width=0.0045,
    )
    above.set(xlabel="x, mm", ylabel="y, mm", aspect="equal")
    above.set_title(f"from above: the longest is {size.max():.2f} mrad")
    middle = poses[:, :2].mean(axis=0)
    away_mm = np.linalg.norm(poses[:, :2] - middle, axis=1)
    along.plot(away_mm, size, "o", color=drawing.AFTER)
    along.plot(
        *binned_medians(away_mm, size, BINS), color=drawing.INK, label="median of each sixth"
    )
    along.set(xlabel="distance from the middle, mm", ylabel="lean, mrad", ylim=(0.0, None))
    drawing.legend_above(figure, along, 1)
    return figure


def magnification(errors_mm: Array) -> float:
    """Round factor that makes the longest of vectors (N, 3) about `ARROW_MM` long."""
    longest = float(np.linalg.norm(errors_mm, axis=1).max())
    if longest == 0.0:
        return 1.0
    wanted = ARROW_MM / longest
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(f * power for f in ROUND_FACTORS if f * power <= wanted))


def turning_data(positions: PositionErrors) -> Markup:
    """Places and errors, both stages at one scale, as JSON that is safe inside a page."""
    before, after = positions.before_mm, positions.after_mm
    told = {
        "shots": positions.numbers,
        "places": positions.poses[:, :3].round(2).tolist(),
        "before": before.round(5).tolist(),
        "after": None if after is None else after.round(5).tolist(),
        "fitted": positions.fitted.tolist(),
        "magnified": magnification(before),
    }
    return Markup(json.dumps(told).replace("<", "\\u003c"))  # noqa: S704 - numbers alone
