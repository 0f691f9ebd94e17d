"""Tests of the paper's section IV.E, shot by shot: straightness, rotation, repeatability."""

from collections.abc import Iterator

import numpy as np

from app.report.figures.picture import AFTER, BEFORE, QUIET, Look, Panel, Picture, Range, span
from campaigns.arrays import AXES, Array
from campaigns.evaluation.validation import (
    LineTest,
    RepeatabilityTest,
    RotationTest,
    ValidationResult,
)

DASHES = {"x": "", "y": "4 2.5", "z": "1.2 2"}
MARKS = {"x": "o", "y": "s", "z": "^"}
ROOM = 1.25
"""Size of a picture of a sphere in its radii."""
STAGES = (("before", BEFORE), ("after", AFTER))


def straightness(before: ValidationResult | None, after: ValidationResult | None) -> Picture:
    """Distance from each line's best line, by direction; a row a stage, a column a line."""
    stages = tuple(_named(before, after))
    picture = Picture(6.0 + 42.0 * len(stages))
    rows = picture.panels(len(stages), len(AXES), shared=True)
    for (name, colour, stage), row in zip(stages, rows, strict=True):
        high = span(*(line.away_mm for line in stage.lines))
        for axis, panel in zip(AXES, row, strict=True):
            _line(panel, stage.line(axis), axis, colour, high)
            line = stage.line(axis)
            size = "not measured" if line is None else f"{line.straightness.value_mm:.3f} mm"
            panel.title(f"{name}, along {axis}: {size}")
    _directions(picture)
    return picture


def rotation(before: RotationTest | None, after: RotationTest | None) -> Picture:
    """Motion of the point from its mean while θ turns, a panel a stage."""
    picture = Picture(59.0)
    turns = (before, after)
    for panel, (name, colour), turn in zip(picture.panels(1, 2)[0], STAGES, turns, strict=True):
        names = ("θ, °", "motion of the point, mm")
        if turn is None:
            panel.axes((0.0, 1.0), (0.0, 1.0), x_numbers=False, y_numbers=False, names=names)
            panel.instead("not measured")
            panel.title(f"{name}: not measured")
            continue
        angles = np.degrees(turn.turn_rad)
        panel.axes(span(angles), span(turn.away_mm), names=names)
        panel.level()
        _components(panel, angles, turn.away_mm, AXES, colour)
        panel.title(f"{name}: {turn.moved.value_mm:.3f} mm")
    _directions(picture)
    return picture


def repeatability(before: RepeatabilityTest | None, after: RepeatabilityTest | None) -> Picture:
    """Repeated visits about their mean from three sides, and the sphere that holds them."""
    picture = Picture(64.0)
    looks = (Look(BEFORE, "o", filled=False), Look(AFTER, "^"))
    clouds = [(*each, c) for each, c in zip(STAGES, (before, after), strict=True) if c]
    room = ROOM * (max(cloud.radius.value_mm for *_, cloud in clouds) or 1.0)
    wide = (-room, room)
    panels = picture.panels(1, 3, title=False)[0]
    for panel, (first, second) in zip(panels, ((0, 1), (0, 2), (1, 2)), strict=True):
        names = (f"{AXES[first]}, mm", f"{AXES[second]}, mm")
        panel.axes(wide, wide, square=True, names=names)
        for name, colour, cloud in clouds:
            look = looks[name == "after"]
            panel.plot(cloud.away_mm[:, first], cloud.away_mm[:, second], look)
            dash = "" if name == "after" else "4 2.5"
            panel.circle(cloud.radius.value_mm, Look(colour, dash=dash))
    picture.legend(
        (f"{name}, sphere of {cloud.radius.value_mm:.3f} mm", looks[name == "after"])
        for name, _, cloud in clouds
    )
    return picture


def _named(
    before: ValidationResult | None, after: ValidationResult | None
) -> Iterator[tuple[str, str, ValidationResult]]:
    """The stages that have lines."""
    for (name, colour), stage in zip(STAGES, (before, after), strict=True):
        if stage is not None and stage.lines:
            yield name, colour, stage


def _line(panel: Panel, line: LineTest | None, axis: str, colour: str, high: Range) -> None:
    first = axis == AXES[0]
    names = (f"{axis}, mm", "away from the line, mm" if first else "")
    if line is None:
        panel.axes((0.0, 1.0), high, x_numbers=False, y_numbers=first, names=names)
        panel.instead("not measured")
        return
    panel.axes(span(line.along_mm), high, y_numbers=first, names=names)
    panel.level()
    across = tuple(other for other in AXES if other != axis)
    _components(panel, line.along_mm, line.away_mm, across, colour)


def _components(
    panel: Panel, places: Array, away_mm: Array, names: tuple[str, ...], colour: str
) -> None:
    for name in names:
        look = Look(colour, MARKS[name], dash=DASHES[name], size=1.5)
        panel.plot(places, away_mm[:, AXES.index(name)], look)


def _directions(picture: Picture) -> None:
    """Legend of the three directions."""
    picture.legend(
        (f"in {name}", Look(QUIET, MARKS[name], dash=DASHES[name], size=1.5)) for name in AXES
    )
