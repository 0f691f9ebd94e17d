"""Figures of the report. Each returns its panels, which stand side by side as far as they fit."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from app.report.drawing import (
    AFTER,
    BEFORE,
    INCH_MM,
    INK,
    QUIET,
    legend_above,
    new_panel,
    new_space,
    show_nothing,
)
from app.report.result_tables import STAGES, PairGroup, Stage
from campaigns.arrays import AXES, Array, Index, Mask
from campaigns.evaluation.summary import binned_medians
from campaigns.evaluation.time_series import TimeSeries
from campaigns.evaluation.validation import ValidationResult
from campaigns.identification.result import ParameterCovariance

COLOURS = {"before": BEFORE, "after": AFTER}
GAP = 3
"""Empty places between two groups of pairs."""
NAMED = 2
"""Largest errors of a group that are marked with their numbers."""
SHADES = (0.95, 0.45, 0.1)
"""Opacity of the groups in a histogram."""
ARROW_MM = 130.0
"""Length at which the longest arrow of the workspace is drawn."""
SIXTHS = 6
LINE_COLOURS = {"x": AFTER, "y": BEFORE, "z": INK}
DASHES = {"x": "-", "y": "--", "z": ":"}
MARKERS = {"x": "o", "y": "s", "z": "^"}
COORDINATES = ("x, mm", "y, mm", "z, mm", "θ, °")
TIME_UNITS = (("hours", 3600.0), ("minutes", 60.0), ("seconds", 1.0))


def pair_errors(groups: Sequence[PairGroup], quantity: str, what: str) -> list[Figure]:
    """Draw the error of every pair or shot, before and after, and after alone on its own scale."""
    stages = [s for s in STAGES if any(g.errors_mm(s) is not None for g in groups)]
    first = "before (open) and after (filled)" if len(stages) > 1 else stages[0]
    titles = {first: stages, "after, on its own scale": stages[1:]}
    panels = []
    for title, shown in titles.items():
        if shown:
            axes = new_panel(title, f"{what}, in the order of the plan", f"{quantity}, mm")
            draw_errors(axes, groups, shown)
            legend_above(axes, len(groups))
            panels.append(axes)
    return _figures(panels)


def draw_errors(axes: Axes, groups: Sequence[PairGroup], stages: Sequence[Stage]) -> None:
    """Draw groups of errors beside each other, the largest ones of the last stage by number."""
    start = 1
    for group in groups:
        places = np.arange(start, start + len(group))
        start += len(group) + GAP
        for stage in stages:
            errors_mm, colour = group.errors_mm(stage), COLOURS[stage]
            if errors_mm is None:
                continue
            fill = colour if stage == "after" else "white"
            look: Any = {"marker": group.marker, "linestyle": "", "color": colour, "mfc": fill}
            label = group.name if stage == stages[-1] else None
            axes.plot(places[: len(errors_mm)], errors_mm, **look, label=label)
            if len(stages) == 1 and len(group.numbers) == len(errors_mm):
                _name_largest(axes, places, errors_mm, group.numbers)
    axes.axhline(0.0, color=QUIET, linewidth=0.7)
    axes.set_xticks([])


def _name_largest(axes: Axes, places: Index, errors_mm: Array, numbers: Sequence[int]) -> None:
    for at in np.argsort(-np.abs(errors_mm))[:NAMED]:
        spot = (places[at], errors_mm[at])
        axes.annotate(str(numbers[at]), spot, (3, 2), textcoords="offset points", size=6.0)


def histogram(groups: Sequence[PairGroup]) -> list[Figure]:
    """Draw the distribution of the errors, each stage on its own scale, groups stacked."""
    panels = []
    for stage in STAGES:
        axes = new_panel(stage, "error of distance, mm", "pairs")
        panels.append(axes)
        errors_mm = {g.name: e for g in groups if (e := g.errors_mm(stage)) is not None}
        if not errors_mm:
            show_nothing(axes, "not measured")
            continue
        together = np.concatenate([*errors_mm.values()])
        bins = min(24, max(6, len(together) // 4))
        edges: Any = np.histogram_bin_edges(together, bins)
        shades = [to_rgba(COLOURS[stage], shade) for shade in SHADES[: len(errors_mm)]]
        axes.hist(
            [*errors_mm.values()],
            edges,
            stacked=True,
            color=shades,
            edgecolor=INK,
            linewidth=0.4,
            label=[*errors_mm],
        )
        axes.axvline(0.0, color=QUIET, linewidth=0.7)
        legend_above(axes, len(errors_mm))
    return _figures(panels)


def error_arrows(poses: Array, before_mm: Array | None, after_mm: Array | None) -> list[Figure]:
    """Draw measured minus modelled positions at the poses, each stage with its magnification."""
    points = poses[:, :3]
    panels = []
    for stage, errors_mm in zip(STAGES, (before_mm, after_mm), strict=True):
        if errors_mm is None:
            continue
        factor = magnification(errors_mm)
        title = f"{stage}: arrows {factor:g} times the error"
        axes = new_space(title, points.min(axis=0), points.max(axis=0))
        axes.plot(*points.T, ".", color=QUIET, markersize=1.0)
        look: Any = {"color": COLOURS[stage], "linewidth": 0.7, "arrow_length_ratio": 0.25}
        axes.quiver(*points.T, *(factor * errors_mm).T, **look)
        panels.append(axes)
    return _figures(panels)


def errors_against_position(poses: Array, errors_mm: Array, fitted: Mask) -> list[Figure]:
    """Draw the length of the error of position against each coordinate of the pose."""
    size_mm = np.linalg.norm(errors_mm, axis=1)
    columns = [*poses[:, :3].T, *np.degrees(poses[:, 3:]).T]
    panels = []
    for name, column in zip(COORDINATES, columns, strict=False):
        axes = new_panel(f"against {name.partition(',')[0]}", name, "error of position, mm")
        axes.plot(column[fitted], size_mm[fitted], "o", color=AFTER, label="fitted")
        axes.plot(
            column[~fitted], size_mm[~fitted], "D", color=AFTER, mfc="white", label="hold-out"
        )
        _draw_medians(axes, column, size_mm)
        panels.append(axes)
    return _figures(panels)


def plate_tilt(poses: Array, tilt_rad: Array) -> list[Figure]:
    """Draw the tilt of the plate: towards where a tool's lower end goes, and by distance."""
    lean_mrad = 1e3 * np.stack([-tilt_rad[:, 1], tilt_rad[:, 0]], axis=1)
    size_mrad = np.linalg.norm(lean_mrad, axis=1)
    x_mm, y_mm = poses[:, :2].T
    above = new_panel(f"from above: the longest is {size_mrad.max():.2f} mrad", "x, mm", "y, mm")
    above.quiver(x_mm, y_mm, *lean_mrad.T, color=AFTER, width=0.004)
    above.set_aspect("equal", adjustable="datalim")
    away_mm = np.linalg.norm(poses[:, :2] - poses[:, :2].mean(axis=0), axis=1)
    along = new_panel("by distance", "distance from the middle, mm", "lean, mrad")
    along.plot(away_mm, size_mrad, "o", color=AFTER)
    _draw_medians(along, away_mm, size_mrad)
    return _figures([above, along])


def straightness(before: ValidationResult | None, after: ValidationResult | None) -> list[Figure]:
    """Draw the distance from the best line of each line, in the two directions across it."""
    panels = []
    for stage, result in zip(STAGES, (before, after), strict=True):
        lines = {axis: line for axis in AXES if result and (line := result.line(axis))}
        sizes = ", ".join(f"{a} {line.straightness.value_mm:.3f}" for a, line in lines.items())
        title = f"{stage}: {sizes} mm" if sizes else f"{stage}: not measured"
        axes = new_panel(title, "place on the line, mm", "away from it, mm")
        panels.append(axes)
        for axis, line in lines.items():
            places_mm = line.along_mm - line.along_mm.mean()
            for across in (name for name in AXES if name != axis):
                axes.plot(
                    places_mm,
                    line.away_mm[:, AXES.index(across)],
                    DASHES[across],
                    marker=MARKERS[across],
                    markersize=2.0,
                    color=LINE_COLOURS[axis],
                    label=f"along {axis}, in {across}",
                )
        if lines:
            axes.axhline(0.0, color=QUIET, linewidth=0.7)
            legend_above(axes, len(lines))
        else:
            show_nothing(axes, "not measured")
    return _figures(panels)


def rotation(before: ValidationResult | None, after: ValidationResult | None) -> list[Figure]:
    """Draw the motion of the point from its mean while θ turns."""
    panels = []
    for stage, result in zip(STAGES, (before, after), strict=True):
        turn = result.rotation if result else None
        moved = f"{turn.moved.value_mm:.3f} mm" if turn else "not measured"
        axes = new_panel(f"{stage}: {moved}", "θ, °", "motion of the point, mm")
        panels.append(axes)
        if turn is None:
            show_nothing(axes, "not measured")
            continue
        for at, axis in enumerate(AXES):
            axes.plot(
                np.degrees(turn.turn_rad),
                turn.away_mm[:, at],
                DASHES[axis],
                marker=MARKERS[axis],
                markersize=2.0,
                color=COLOURS[stage],
                label=f"in {axis}",
            )
        axes.axhline(0.0, color=QUIET, linewidth=0.7)
        legend_above(axes, len(AXES))
    return _figures(panels)


def repeatability(before: ValidationResult | None, after: ValidationResult | None) -> list[Figure]:
    """Draw repeated visits about their mean, from above and from the side, and their sphere."""
    results = zip(STAGES, (before, after), strict=True)
    visits = {stage: test for stage, r in results if r and (test := r.repeatability)}
    reach_mm = 1.25 * (max(test.radius.value_mm for test in visits.values()) or 1.0)
    panels = []
    for first, second in ((0, 1), (0, 2)):
        title = f"{AXES[first]} and {AXES[second]}"
        axes = new_panel(title, f"{AXES[first]}, mm", f"{AXES[second]}, mm")
        axes.set_ylim(-reach_mm, reach_mm)
        axes.set_aspect("equal", adjustable="datalim")
        for stage, test in visits.items():
            colour, radius_mm = COLOURS[stage], test.radius.value_mm
            axes.plot(
                test.away_mm[:, first],
                test.away_mm[:, second],
                "o" if stage == "before" else "^",
                color=colour,
                mfc="white" if stage == "before" else colour,
                label=f"{stage}, sphere of {radius_mm:.3f} mm",
            )
            style = "--" if stage == "before" else "-"
            axes.add_patch(Circle((0.0, 0.0), radius_mm, fill=False, color=colour, linestyle=style))
        legend_above(axes, len(visits))
        panels.append(axes)
    return _figures(panels)


def over_time(courses: Sequence[TimeSeries]) -> list[Figure]:
    """Draw the temperature of the air and the drift of the reference pose, by series."""
    longest_s = max(course.longest_s for course in courses)
    unit, unit_s = next((u for u in TIME_UNITS if longest_s >= 3.0 * u[1]), TIME_UNITS[-1])
    x = f"{unit} since the series' first shot"
    air, drift = new_panel("air", x, "air, °C"), new_panel("drift", x, "drift pose moved, mm")
    for course, marker, colour in zip(
        courses, "osD^v" * len(courses), (AFTER, BEFORE, INK) * len(courses), strict=False
    ):
        look: Any = {"marker": marker, "color": colour, "markersize": 2.4, "label": course.name}
        if len(course.temperature_s) > 1:
            air.plot(course.temperature_s / unit_s, course.temperature_degC, linestyle="", **look)
        if len(course.drift_s) > 1:
            drift.plot(course.drift_s / unit_s, course.drift_mm, **look)
    for axes in (air, drift):
        if axes.lines:
            legend_above(axes, len(courses))
        else:
            show_nothing(axes, "not recorded")
    return _figures([air, drift])


def correlation_map(known: ParameterCovariance) -> list[Figure]:
    """Draw |ρ| of every two parameters as shades of grey."""
    std = np.sqrt(np.diag(known.array))
    size = np.abs(known.array) / np.maximum(np.outer(std, std), np.finfo(np.float64).tiny)
    places = np.arange(len(known.names)) + 0.5
    letters = min(6.5, 260.0 / len(known.names))
    figure = Figure(figsize=(150.0 / INCH_MM, 130.0 / INCH_MM))
    axes = figure.add_axes((0.22, 0.22, 0.65, 0.75), aspect="equal")
    shown = np.ma.masked_where(np.triu(np.ones_like(size)) > 0.0, size)
    shades = axes.pcolormesh(shown, cmap="Greys", vmin=0.0, vmax=1.0)
    axes.set_xticks(places, known.names, rotation=90, size=letters)
    axes.set_yticks(places, known.names, size=letters)
    axes.invert_yaxis()
    axes.grid(visible=False)
    figure.colorbar(shades, cax=figure.add_axes((0.9, 0.4, 0.02, 0.5)), label="|ρ|")
    return [figure]


def magnification(errors_mm: Array) -> float:
    """Return the round factor that makes the longest of vectors (N, 3) about `ARROW_MM` long."""
    longest_mm = float(np.linalg.norm(errors_mm, axis=1).max())
    if longest_mm == 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(ARROW_MM / longest_mm))
    return float(max(f * power for f in (1, 2, 5) if f * power * longest_mm <= ARROW_MM))


def _draw_medians(axes: Axes, values: Array, sizes: Array) -> None:
    axes.plot(*binned_medians(values, sizes, SIXTHS), color=INK, label="median of each sixth")
    axes.set_ylim(bottom=0.0)
    legend_above(axes, 3)


def _figures(panels: Sequence[Axes]) -> list[Figure]:
    figures = [axes.get_figure(root=True) for axes in panels]
    return [figure for figure in figures if figure is not None]
