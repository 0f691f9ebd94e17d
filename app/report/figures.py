"""Figures of the report. Each returns its panels, which stand side by side as far as they fit.

Every panel is a picture of its own size, so the page can put two in a row on A4 and one below the
other on a phone. What must be compared has one scale: x and y of places, and the visits before and
after. What would vanish on a common scale has its own: errors after calibration are often ten times
smaller than those before, so they are drawn once beside them and once alone. Before and after
differ in colour and in fill or marker, directions in dashes and marker, so that grey print keeps
them apart. Figures compute nothing that a table states: they draw the arrays of the evaluation.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
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
    show_nothing,
)
from app.report.tables import STAGES, PairGroup, Stage
from campaigns.arrays import AXES, Array, Mask
from campaigns.evaluation.model_errors import PositionErrors
from campaigns.evaluation.time_series import TimeSeries
from campaigns.evaluation.validation import ValidationResult
from campaigns.identification.pictures import draw_arrows, draw_correlation_map, magnification
from campaigns.identification.result import ParameterCovariance
from campaigns.kinematics.axes import Axis

Results = tuple[ValidationResult | None, ValidationResult | None]
"""Validation before and after calibration."""
COLOURS = {"before": BEFORE, "after": AFTER}
GAP = 3
"""Number of empty places between two groups of pairs."""
NUMBERED = 2
"""Number of largest errors of a group that are marked with the pair's number."""
LINE_COLOURS = {"x": AFTER, "y": BEFORE, "z": INK}
DASHES = {"x": "-", "y": "--", "z": ":"}
MARKERS = {"x": "o", "y": "s", "z": "^"}
GREEK = {"theta": "θ"}
"""Axes that have another name on the page than in files."""
NO_PLACES = np.empty((0, 3))
TIME_UNITS = (("hours", 3600.0), ("minutes", 60.0), ("seconds", 1.0))


def pair_errors(groups: Sequence[PairGroup]) -> list[Figure]:
    """Draw the error of every pair, before and after, and after alone on its own scale.

    The largest have the numbers of their pairs where one stage is drawn alone: beside the errors
    before, those after are a line on which numbers would hide each other.
    """
    # the second panel repeats the later stage alone, if both stages were measured
    stages = [s for s in STAGES if any(group.errors_mm[s] is not None for group in groups)]
    first = "before (open) and after (filled)" if len(stages) > 1 else stages[0]
    panels = []
    for title, shown in {first: stages, "after, on its own scale": stages[1:]}.items():
        if not shown:
            continue
        axes = new_panel(title, "pairs, in the order of the plan", "error of distance, mm")
        start = 1
        for group in groups:
            for stage in shown:
                _draw_errors(axes, start, group, stage, is_last=stage == shown[-1])
            if len(shown) == 1:
                _draw_numbers(axes, start, group, shown[0])
            start += len(group) + GAP
        axes.axhline(0.0, color=QUIET, linewidth=0.7)
        axes.set_xticks([])
        legend_above(axes, len(groups))
        panels.append(axes)
    return figures_of(panels)


def _draw_errors(axes: Axes, start: int, group: PairGroup, stage: Stage, *, is_last: bool) -> None:
    """Draw a group's errors of a stage, with the label if the stage is the last one."""
    errors_mm = group.errors_mm[stage]
    if errors_mm is None:
        return
    places = np.arange(start, start + len(errors_mm))
    fill = AFTER if stage == "after" else "white"
    look: Any = {"marker": group.marker, "linestyle": "", "color": COLOURS[stage], "mfc": fill}
    axes.plot(places, errors_mm, **look, label=group.name if is_last else None)


def _draw_numbers(axes: Axes, start: int, group: PairGroup, stage: Stage) -> None:
    """Name a group's largest errors of a stage by the numbers of their pairs."""
    errors_mm = group.errors_mm[stage]
    if errors_mm is None or len(group.numbers) != len(errors_mm):
        return
    for at in np.argsort(-np.abs(errors_mm))[:NUMBERED]:
        spot, number = (start + at, errors_mm[at]), str(group.numbers[at])
        axes.annotate(number, spot, (3, 2), textcoords="offset points", size=6.0)


def error_arrows(errors: PositionErrors, left_out_mm: Array = NO_PLACES) -> list[Figure]:
    """Draw measured minus modelled positions, from above and from the side, by stage.

    Crosses mark places (K, 3) whose shots were left out.
    """
    # Errors of 0.1 mm are invisible in a workspace of 1 m, so arrows are longer than the errors, by
    # a factor in the title. Each stage has its own factor; both views of a stage share it.
    panels = []
    for stage, errors_mm in zip(STAGES, (errors.before_mm, errors.after_mm), strict=True):
        if errors_mm is None:
            continue
        factor = magnification(errors_mm, errors.poses[:, :3])
        for view, axis, side in (("from above", 1, "y, mm"), ("from the side", 2, "z, mm")):
            axes = new_panel(f"{stage}, {view}: arrows {factor:g} × error", "x, mm", side)
            sides = [0, axis]
            lengths = factor * errors_mm[:, sides]
            draw_arrows(axes, errors.poses[:, sides], lengths, COLOURS[stage])
            if len(left_out_mm):
                cross: Any = {"color": INK, "markersize": 5.0, "label": "left out"}
                axes.plot(*left_out_mm[:, sides].T, "x", **cross)
                legend_above(axes, 1)
            panels.append(axes)
    return figures_of(panels)


def errors_against_position(
    poses: Array, errors_mm: Array, fitted: Mask, task: Sequence[Axis]
) -> list[Figure]:
    """Draw the length of the error of position against each coordinate of poses (N, t)."""
    size_mm = np.linalg.norm(errors_mm, axis=1)
    panels = []
    for axis, values in zip(task, poses.T, strict=True):
        if axis.is_fixed:
            continue
        column = np.degrees(values) if axis.is_revolute else values
        name = GREEK.get(axis.name, axis.name)
        unit = "°" if axis.is_revolute else "mm"
        axes = new_panel(f"against {name}", f"{name}, {unit}", "error of position, mm")
        axes.plot(column[fitted], size_mm[fitted], "o", color=AFTER, label="fitted")
        axes.plot(
            column[~fitted], size_mm[~fitted], "D", color=AFTER, mfc="white", label="hold-out"
        )
        # The median of each sixth of the shots, in the order of the coordinate, shows a trend that
        # single points hide. Parts of equal number, not of equal width: no part is empty, and a
        # median is not moved by one wrong shot.
        sixths = np.array_split(np.argsort(column), min(6, len(column)))
        medians = [(np.median(column[part]), np.median(size_mm[part])) for part in sixths]
        axes.plot(*np.transpose(medians), color=INK, label="median of each sixth")
        axes.set_ylim(bottom=0.0)
        legend_above(axes, 3)
        panels.append(axes)
    return figures_of(panels)


def straightness(results: Results) -> list[Figure]:
    """Draw the distance from the best line of each line, in the two directions across it."""
    panels = []
    for stage, result in zip(STAGES, results, strict=True):
        lines = {axis: line for axis in AXES if result and (line := result.line(axis))}
        sizes = ", ".join(f"{a} {line.straightness.value_mm:.3f}" for a, line in lines.items())
        axes = _stage_panel(stage, f"{sizes} mm" if sizes else "", "place on the line, mm")
        axes.set_ylabel("distance from it, mm")
        # across a commanded line along x, say, there are y and z: a curve for each of them
        for axis, line in lines.items():
            places_mm = line.along_mm - line.along_mm.mean()
            for across in (name for name in AXES if name != axis):
                away_mm = line.away_mm[:, AXES.index(across)]
                label = f"along {axis}, in {across}"
                _draw_course(
                    axes, places_mm, away_mm, across, color=LINE_COLOURS[axis], label=label
                )
        panels.append(axes)
        _finish(axes, len(lines))
    return figures_of(panels)


def rotation(results: Results) -> list[Figure]:
    """Draw the motion of the point from its mean while the platform turns, an axis at a time."""
    panels = []
    for stage, result in zip(STAGES, results, strict=True):
        turn = result.rotation if result else None
        axes = _stage_panel(stage, f"{turn.moved.value_mm:.3f} mm" if turn else "", "turn, °")
        axes.set_ylabel("motion of the point, mm")
        if turn:
            turn_deg, colour = np.degrees(turn.turn_rad), COLOURS[stage]
            for about in np.unique(turn.about).tolist():
                rows = turn.about == about
                for axis, away_mm in zip(AXES, turn.away_mm[rows].T, strict=True):
                    label = None if about else f"in {axis}"
                    _draw_course(axes, turn_deg[rows], away_mm, axis, color=colour, label=label)
        panels.append(axes)
        _finish(axes, len(AXES))
    return figures_of(panels)


def _stage_panel(stage: str, size: str, x: str) -> Axes:
    return new_panel(f"{stage}: {size or 'not measured'}", x)


def _draw_course(axes: Axes, x: Array, y: Array, direction: str, **look: Any) -> None:
    """Draw a line with the dashes and the marker of a direction of the base frame."""
    axes.plot(x, y, DASHES[direction], marker=MARKERS[direction], markersize=2.0, **look)


def _finish(axes: Axes, columns: int) -> None:
    """Draw the zero line and the legend, or say that nothing was measured."""
    if axes.lines:
        axes.axhline(0.0, color=QUIET, linewidth=0.7)
        legend_above(axes, columns)
    else:
        show_nothing(axes, "not measured")


def repeatability(results: Results) -> list[Figure]:
    """Draw repeated visits about their mean, from above and from the side, and their sphere."""
    # Both stages in one panel, on one scale: the question is whether the cloud of visits changed.
    # The axes reach a quarter beyond the larger sphere.
    stages = zip(STAGES, results, strict=True)
    visits = {stage: test for stage, r in stages if r and (test := r.repeatability)}
    reach_mm = 1.25 * (max(test.radius.value_mm for test in visits.values()) or 1.0)
    panels = []
    for second in (1, 2):
        title = f"{AXES[0]} and {AXES[second]}"
        axes = new_panel(title, f"{AXES[0]}, mm", f"{AXES[second]}, mm")
        axes.set_ylim(-reach_mm, reach_mm)
        axes.set_aspect("equal", adjustable="datalim")
        for stage, test in visits.items():
            colour, radius_mm = COLOURS[stage], test.radius.value_mm
            marker, fill, dashes = ("o", "white", "--") if stage == "before" else ("^", colour, "-")
            label = f"{stage}, sphere of {radius_mm:.3f} mm"
            points_mm = test.away_mm[:, [0, second]].T
            axes.plot(*points_mm, marker, color=colour, mfc=fill, label=label)
            circle = Circle((0.0, 0.0), radius_mm, fill=False, color=colour, linestyle=dashes)
            axes.add_patch(circle)
        legend_above(axes, len(visits))
        panels.append(axes)
    return figures_of(panels)


def over_time(courses: Sequence[TimeSeries]) -> list[Figure]:
    """Draw the temperature of the air and the drift of the reference pose, by series."""
    # the largest unit of which the longest series has at least three: labels of few digits
    longest_s = max(course.longest_s for course in courses)
    unit, unit_s = next((u for u in TIME_UNITS if longest_s >= 3.0 * u[1]), TIME_UNITS[-1])
    x = f"{unit} since the series' first shot"
    air, drift = new_panel("air", x, "air, °C"), new_panel("drift", x, "drift pose moved, mm")
    for at, course in enumerate(courses):
        marker, colour = "osD^v"[at % 5], (AFTER, BEFORE, INK)[at % 3]
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
    return figures_of([air, drift])


def correlation_map(covariance: ParameterCovariance) -> list[Figure]:
    """Draw |ρ| of every two parameters as shades of grey."""
    # One panel alone, narrower than the text of A4: a row for each parameter gives it the height of
    # a third of the page.
    figure = Figure(figsize=(150.0 / INCH_MM, 130.0 / INCH_MM))
    draw_correlation_map(figure, covariance)
    return [figure]


def figures_of(panels: Sequence[Axes]) -> list[Figure]:
    """Return the figures of panels, each once."""
    figures = [axes.get_figure(root=True) for axes in panels]
    return [figure for figure in figures if figure is not None]
