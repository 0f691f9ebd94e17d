"""Pictures made of letters, for a terminal: a histogram by bars of eighths of a letter."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from campaigns.planning.plan_file import PlannedShot
from campaigns.shots.shot_sets import ShotSet

EIGHTHS = " ▏▎▍▌▋▊▉█"
BINS = 9
LEAST = 1e-6
"""Errors below this need no picture of their own."""
WIDTH = 40
"""Letters of the longest bar."""


def histogram_lines(errors_mm: Sequence[float]) -> list[str]:
    """One line a bin: its limits, a bar, the count; no line for no errors.

    The bins lie evenly about zero, so that a lean to one side is seen.
    """
    if len(errors_mm) == 0:
        return []
    largest = max(float(np.abs(errors_mm).max()), LEAST)
    counts, edges = np.histogram(errors_mm, BINS, (-largest, largest))
    decimals = max(0, 2 - int(np.floor(np.log10(largest))))
    limits = [f"{edge:+.{decimals}f}".replace("-", "−") for edge in edges]
    room = max(map(len, limits))
    return [
        f"{low:>{room}} … {high:>{room}} mm {bar(count / counts.max(), WIDTH)} {count}"
        for low, high, count in zip(limits[:-1], limits[1:], counts.tolist(), strict=True)
    ]


def bar(part: float, width: int) -> str:
    """A bar of so large a part of the width, (0 to 1), filled up with blanks."""
    eighths = round(part * width * 8)
    whole, rest = divmod(eighths, 8)
    return ("█" * whole + EIGHTHS[rest].strip()).ljust(width)


VIEW_WIDTH = 36
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
    right += [" " * VIEW_WIDTH] * (len(left) - len(right))
    left += [" " * VIEW_WIDTH] * (len(right) - len(left))
    titles = f"{'from above (x →, y ↑)':<{VIEW_WIDTH}}{MARGIN}from the side (x →, z ↑)"
    key = f"o identification, x validation, + drift; {width_mm:.0f} mm wide"
    pictured = [f"{one}{MARGIN}{other}".rstrip() for one, other in zip(left, right, strict=True)]
    return [titles, *pictured, key]


def _view(points: Points, width_mm: float) -> list[str]:
    columns_per_mm = (VIEW_WIDTH - 1) / width_mm
    rows_per_mm = columns_per_mm * ROWS_PER_COLUMN
    left, top = min(map(_across, points)), max(map(_up, points))
    height = round(_span(points, _up) * rows_per_mm) + 1
    grid = [[" "] * VIEW_WIDTH for _ in range(height)]
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
