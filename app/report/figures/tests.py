"""Tests of the paper's section IV.E, shot by shot: straightness, rotation, repeatability."""

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from app.report.figures import drawing
from campaigns.arrays import AXES, Array
from campaigns.evaluation.validation import (
    LineTest,
    RepeatabilityTest,
    RotationTest,
    ValidationResult,
)

STYLES = {"x": "-", "y": "--", "z": ":"}
MARKS = {"x": "o", "y": "s", "z": "^"}
ROOM = 1.25
"""Size of a picture of a sphere in its radii."""


@drawing.in_house_style
def straightness(before: ValidationResult | None, after: ValidationResult | None) -> Figure:
    """Distance from each line's best line, by direction; a row a stage, a column a line."""
    stages = tuple(_named(before, after))
    figure = drawing.new_figure(12.0 + 39.0 * len(stages))
    rows = figure.subplots(len(stages), len(AXES), squeeze=False, sharey="row")
    for (name, colour, stage), row in zip(stages, rows, strict=True):
        for axis, axes in zip(AXES, row, strict=True):
            _line(axes, stage.line(axis), axis, name, colour)
        row[0].set_ylabel("away from the line, mm")
    for axis, axes in zip(AXES, rows[-1], strict=True):
        axes.set_xlabel(f"{axis}, mm")
    return figure


@drawing.in_house_style
def rotation(before: RotationTest | None, after: RotationTest | None) -> Figure:
    """Motion of the point from its mean while θ turns, a panel a stage."""
    figure = drawing.new_figure(55.0)
    panels = (("before", drawing.BEFORE, before), ("after", drawing.AFTER, after))
    every = figure.subplots(1, 2)
    for axes, (name, colour, turn) in zip(every, panels, strict=True):
        axes.set(xlabel="θ, °", ylabel="motion of the point, mm")
        drawing.zero_line(axes)
        if turn is None:
            _not_measured(axes, name)
            continue
        _components(axes, np.degrees(turn.turn_rad), turn.away_mm, AXES, colour)
        axes.set_title(f"{name}: {turn.moved.value_mm:.3f} mm")
    drawing.legend_above(figure, every[0] if before else every[1], len(AXES))
    return figure


@drawing.in_house_style
def repeatability(before: RepeatabilityTest | None, after: RepeatabilityTest | None) -> Figure:
    """Repeated visits about their mean from three sides, and the sphere that holds them."""
    figure = drawing.new_figure(66.0)
    every = figure.subplots(1, 3, sharex=True, sharey=True)
    clouds = (("before", drawing.BEFORE, "o", before), ("after", drawing.AFTER, "^", after))
    for axes, (first, second) in zip(every, ((0, 1), (0, 2), (1, 2)), strict=True):
        for name, colour, marker, cloud in clouds:
            if cloud is not None:
                away = cloud.away_mm
                axes.plot(
                    away[:, first],
                    away[:, second],
                    marker,
                    color=colour,
                    markerfacecolor="white" if name == "before" else colour,
                    label=f"{name}, sphere of {cloud.radius.value_mm:.3f} mm",
                )
                _circle(axes, cloud.radius.value_mm, colour, dashed=name == "before")
        axes.set(xlabel=f"{AXES[first]}, mm", ylabel=f"{AXES[second]}, mm", aspect="equal")
    largest = max(cloud.radius.value_mm for _, _, _, cloud in clouds if cloud is not None)
    room = ROOM * (largest or 1.0)
    every[0].set(xlim=(-room, room), ylim=(-room, room))
    drawing.legend_above(figure, every[0], 2)
    return figure


def _named(
    before: ValidationResult | None, after: ValidationResult | None
) -> Iterator[tuple[str, str, ValidationResult]]:
    """The stages that have lines."""
    for name, colour, stage in (
        ("before", drawing.BEFORE, before),
        ("after", drawing.AFTER, after),
    ):
        if stage is not None and stage.lines:
            yield name, colour, stage


def _line(axes: Axes, line: LineTest | None, axis: str, name: str, colour: str) -> None:
    drawing.zero_line(axes)
    if line is None:
        _not_measured(axes, f"{name}, along {axis}")
        return
    across = tuple(other for other in AXES if other != axis)
    _components(axes, line.along_mm, line.away_mm, across, colour)
    axes.set_title(f"{name}, along {axis}: {line.straightness.value_mm:.3f} mm")
    axes.legend(loc="best")


def _components(
    axes: Axes, places: Array, away_mm: Array, names: tuple[str, ...], colour: str
) -> None:
    for name in names:
        axes.plot(
            places,
            away_mm[:, AXES.index(name)],
            linestyle=STYLES[name],
            marker=MARKS[name],
            markersize=3.0,
            color=colour,
            label=f"in {name}",
        )


def _circle(axes: Axes, radius_mm: float, colour: str, *, dashed: bool) -> None:
    style = "--" if dashed else "-"
    axes.add_patch(Circle((0.0, 0.0), radius_mm, fill=False, color=colour, linestyle=style))


def _not_measured(axes: Axes, name: str) -> None:
    axes.set_title(f"{name}: not measured")
    drawing.say_instead(axes, "not measured")
