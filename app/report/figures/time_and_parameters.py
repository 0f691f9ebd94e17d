"""Drift and temperature over time; how the identified parameters hang together."""

from collections.abc import Sequence

import numpy as np

from app.report.figures.picture import (
    AFTER,
    EDGE,
    LETTER,
    QUIET,
    SMALL_SIZE,
    Look,
    Panel,
    Picture,
    span,
)
from campaigns.arrays import Array
from campaigns.evaluation.time_series import TimeSeries
from campaigns.identification.result import ParameterCovariance

UNITS = (("hours", 3600.0), ("minutes", 60.0), ("seconds", 1.0))
LEAST_VALUES = 2
"""One value shows no course."""
AT_LEAST = 3.0
"""A unit of time is used from so many of it on."""
SCALE = 40.0
FAINTEST = 0.02
"""Correlations smaller than this are white."""


def over_time(courses: Sequence[TimeSeries]) -> Picture:
    """Above the air's temperature, below the drift pose; a column a series."""
    picture = Picture(84.0)
    unit, unit_s = _unit(max(course.longest_s for course in courses))
    rows = picture.panels(2, len(courses), legend=False, shared=True, between=8.0)
    airs = span(*(course.temperature_degC for course in courses), room=0.3)
    moved = span(*(course.drift_mm for course in courses), zero=True)
    for place, (course, warm, drift) in enumerate(zip(courses, *rows, strict=True)):
        times = span(course.temperature_s / unit_s, course.drift_s / unit_s)
        first, of = place == 0, f"{unit} since the first shot"
        air, motion = ("air, °C", "drift pose moved, mm") if first else ("", "")
        warm.axes(times, airs, names=("", air), x_numbers=False, y_numbers=first)
        drift.axes(times, moved, names=(of, motion), y_numbers=first)
        warm.title(course.name)
        drift.level()
        _plot(warm, course.temperature_s / unit_s, course.temperature_degC, size=1.1)
        _plot(drift, course.drift_s / unit_s, course.drift_mm, dash="")
    return picture


def correlation_map(known: ParameterCovariance) -> Picture:
    """Draw |ρ| of every two parameters as shades of grey."""
    names, std = known.names, np.sqrt(np.diag(known.array))
    size = np.abs(known.array) / np.maximum(np.outer(std, std), np.finfo(np.float64).tiny)
    picture = Picture(118.0)
    room = 6.0 + LETTER * SMALL_SIZE * max(map(len, names))  # for names, beside and below
    side = (picture.height - room - EDGE) / len(names)
    left, top = 0.5 * (picture.width - SCALE - len(names) * side) + 0.3 * room, EDGE
    foot = top + len(names) * side
    letters = min(SMALL_SIZE, 0.9 * side)
    for row, name in enumerate(names):
        middle = (row + 0.5) * side
        picture.text(left - 4.0, top + middle + 2.3, name, size=letters, anchor="end")
        at = left + middle + 2.3
        picture.text(at, foot + 4.0, name, size=letters, anchor="end", upwards=True)
        for column in np.flatnonzero(size[row, :row] >= FAINTEST).tolist():
            shade = float(size[row, column])
            picture.cell(left + column * side, top + row * side, side, side, shade)
    picture.line(
        [(left, top), (left, foot), (left + len(names) * side, foot)], Look(QUIET, dash="")
    )
    beside, high = left + len(names) * side + 24.0, 0.6 * (foot - top)
    for step in range(20):
        picture.cell(
            beside, top + high * (1.0 - (step + 1) / 20), 9.0, high / 20, (step + 0.5) / 20
        )
    for tenth in range(0, 11, 2):
        at = top + high * (1.0 - tenth / 10)
        picture.text(beside + 13.0, at + 2.7, f"{tenth / 10:.1f}")
    picture.text(beside, top + high + 14.0, "|ρ|")
    return picture


def _plot(
    panel: Panel, times: Array, values: Array, *, dash: str | None = None, size: float = 1.8
) -> None:
    if len(values) < LEAST_VALUES:
        panel.instead("not recorded here")
        return
    panel.plot(times, values, Look(AFTER, "o", dash=dash, size=size))


def _unit(longest_s: float) -> tuple[str, float]:
    """The unit of time that suits, and its seconds."""
    return next((named for named in UNITS if longest_s >= AT_LEAST * named[1]), UNITS[-1])
