"""Drift and temperature over time; how the identified parameters hang together."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from app.report.figures import drawing
from campaigns.arrays import Array
from campaigns.estimation.information import Uncertainty
from campaigns.evaluation.time_series import TimeSeries

UNITS = (("hours", 3600.0), ("minutes", 60.0), ("seconds", 1.0))
LEAST_VALUES = 2
"""One value shows no course."""
AT_LEAST = 3.0
"""A unit of time is used from so many of it on."""


@drawing.in_house_style
def over_time(courses: Sequence[TimeSeries]) -> Figure:
    """Above the air's temperature, below the drift pose; a column a series."""
    figure = drawing.new_figure(84.0)
    unit, unit_s = _unit(max(course.longest_s for course in courses))
    rows = figure.subplots(2, len(courses), sharex="col", sharey="row", squeeze=False)
    for course, warm, drift in zip(courses, *rows, strict=True):
        warm.set_title(course.name)
        _plot(warm, course.temperature_s / unit_s, course.temperature_degC, ".")
        _plot(drift, course.drift_s / unit_s, course.drift_mm, "o-")
        drawing.zero_line(drift)
        drift.set_xlabel(f"{unit} since the first shot")
    rows[0, 0].set_ylabel("air, °C")
    rows[0, 0].ticklabel_format(useOffset=False)
    rows[0, 0].margins(y=0.3)
    rows[1, 0].set_ylabel("drift pose moved, mm")
    return figure


@drawing.in_house_style
def correlation_map(known: Uncertainty) -> Figure:
    """|ρ| of every two parameters as shades of grey."""
    names, size = known.names, np.abs(known.correlations())
    figure = drawing.new_figure(118.0)
    axes = figure.subplots()
    below = np.ma.array(size, mask=np.triu(np.ones_like(size, dtype=bool)))
    image = axes.imshow(below, cmap="Greys", vmin=0.0, vmax=1.0)
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=6.5)
    axes.set_yticks(range(len(names)), names, fontsize=6.5)
    axes.grid(visible=False)
    bar = figure.colorbar(image, shrink=0.6, label="|ρ|")
    bar.outline.set_edgecolor(drawing.QUIET)
    return figure


def _plot(axes: Axes, times: Array, values: Array, style: str) -> None:
    if len(values) < LEAST_VALUES:
        drawing.say_instead(axes, "not recorded here")
        return
    axes.plot(
        times, values, style, color=drawing.AFTER, markeredgecolor=drawing.INK, markeredgewidth=0.3
    )


def _unit(longest_s: float) -> tuple[str, float]:
    """The unit of time that suits, and its seconds."""
    return next((named for named in UNITS if longest_s >= AT_LEAST * named[1]), UNITS[-1])
