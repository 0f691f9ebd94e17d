"""A plan drawn with letters: from above and from the side."""

from collections.abc import Callable, Iterable, Sequence

from campaigns.planning.plan_file import PlannedShot
from campaigns.shot_sets import ShotSet

WIDTH = 36
"""Columns of one view."""
ROWS_PER_COLUMN = 0.5
"""A letter is about twice as high as wide."""
MARGIN = "  "
MARKS = {ShotSet.IDENTIFICATION: "o", ShotSet.VALIDATION: "x", ShotSet.DRIFT: "+"}

Points = Sequence[tuple[float, float, str]]


def plan_picture(shots: Iterable[PlannedShot]) -> list[str]:
    """Lines with both views beside each other, drawn to the same scale."""
    marked = [(shot.pose, MARKS[shot.purpose]) for shot in shots if shot.purpose in MARKS]
    above = [(pose.x_mm, pose.y_mm, mark) for pose, mark in marked]
    aside = [(pose.x_mm, pose.z_mm, mark) for pose, mark in marked]
    width_mm = max(_span(above, _across), _span(aside, _across), 1.0)
    left, right = _view(above, width_mm), _view(aside, width_mm)
    right += [" " * WIDTH] * (len(left) - len(right))
    left += [" " * WIDTH] * (len(right) - len(left))
    titles = f"{'from above (x →, y ↑)':<{WIDTH}}{MARGIN}from the side (x →, z ↑)"
    key = f"o to identify from, x unseen, + drift; {width_mm:.0f} mm wide"
    pictured = [f"{one}{MARGIN}{other}".rstrip() for one, other in zip(left, right, strict=True)]
    return [titles, *pictured, key]


def _view(points: Points, width_mm: float) -> list[str]:
    columns_per_mm = (WIDTH - 1) / width_mm
    rows_per_mm = columns_per_mm * ROWS_PER_COLUMN
    left, top = min(map(_across, points)), max(map(_up, points))
    height = round(_span(points, _up) * rows_per_mm) + 1
    grid = [[" "] * WIDTH for _ in range(height)]
    for across, up, mark in points:
        grid[round((top - up) * rows_per_mm)][round((across - left) * columns_per_mm)] = mark
    return ["".join(row) for row in grid]


def _span(points: Points, of: Callable[[tuple[float, float, str]], float]) -> float:
    values = [of(point) for point in points]
    return max(values) - min(values)


def _across(point: tuple[float, float, str]) -> float:
    return point[0]


def _up(point: tuple[float, float, str]) -> float:
    return point[1]
