"""Warmth: how warm a robot's parts were at each shot, which is what they grow by.

By temperatures of the parts where somebody measured them; else by how far the drift pose, which is
visited again and again, had moved by then; else by the time since the run began, in which a body
warms up like 1 - exp(-t / τ).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import ShotsInvalid
from campaigns.estimation.change_detection import drifted
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots
from campaigns.shots.shots_csv import times_s

TIME_CONSTANTS = (0.1, 0.2, 1.0 / 3.0, 0.6, 1.2, math.inf)
"""Of warming up that are tried, in parts of the run; by the last it goes on evenly."""
FINER = (1.35, 1.16, 1.08)
"""Factors of the time constant that explains most, one after the other."""
LOG_SPREAD = math.log(TIME_CONSTANTS[-2] / TIME_CONSTANTS[0]) / math.sqrt(12.0)
"""σ of a time constant's logarithm that may be any of those with equal chance."""
LOG_STEP = 0.05
"""Of a time constant, for a derivative."""
FEWEST_VISITS = 5
"""Of the drift pose by which a course can be told."""
ALONG = 10.0
"""Motion of the drift pose along a line over that across it: growth is on a line, noise is not."""
LEAST_DEGC = 0.2
"""Change of parts' temperatures by which growth can be told."""

Source = Literal["temperature", "drift pose", "time"]


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Course of warmth over shots, by which all that grows does so."""

    source: Source
    values: Array
    """(N,): °C above the reference temperature; else -1 at the other end, 0 at the end of the run,
    which is then the state that parameters are stated in."""
    time_constant: float | None = None
    """Of warmth by time, in parts of the run."""
    reference_degC: float | None = None
    """Of warmth by temperature: what 0 stands for."""
    errors: Array | None = None
    """Of warmth by time: changes by one σ of what is known of its time constant before, (N,)."""

    @classmethod
    def by_time(cls, passed: Array, time_constant: float) -> "Course":
        """Course over the parts of a run that have passed, (N,)."""
        values = drifted(passed, time_constant)
        if math.isinf(time_constant):
            errors = drifted(passed, TIME_CONSTANTS[-2]) - values
        else:
            ends = (time_constant * math.exp(step) for step in (LOG_STEP, -LOG_STEP))
            slower, faster = (drifted(passed, each) for each in ends)
            errors = LOG_SPREAD / (2.0 * LOG_STEP) * (slower - faster)
        return cls("time", values - 1.0, time_constant, errors=errors)

    @property
    def told(self) -> dict[str, float | str | None]:
        """Course in a result: its source, time constant in parts of the run, reference."""
        finite = self.time_constant is not None and math.isfinite(self.time_constant)
        return {
            "source": self.source,
            "time_constant": self.time_constant if finite else None,
            "reference_degC": self.reference_degC,
        }

    @property
    def begun(self) -> "Course":
        """The same, 0 where nothing has grown: at the start, or at the reference temperature."""
        known = self.reference_degC is not None
        return self if known else replace(self, values=self.values - self.values.min(initial=0.0))

    @property
    def passed(self) -> Array:
        """Part of the change that has come about, from 0 to 1, (N,)."""
        return np.asarray((self.values - self.values.min()) / np.ptp(self.values))


def courses(shots: Shots, reference_degC: float) -> tuple[Course, ...]:
    """Courses that the warmth of a robot may have had: of time one for each time constant."""
    passed = part_passed(shots)
    degC, drift = shots.part_temperature_degC, _moved(shots, passed)
    known = np.isfinite(degC)
    if by_temperature(shots):
        order = np.flatnonzero(known)[np.argsort(passed[known], kind="stable")]
        whole = np.interp(passed, passed[order], degC[order])
        above = whole - reference_degC
        return (Course("temperature", above, reference_degC=reference_degC),)
    if drift is not None:
        return (Course("drift pose", drift),)
    return tuple(Course.by_time(passed, each) for each in TIME_CONSTANTS)


def finer(shots: Shots, course: Course, factor: float) -> tuple[Course, ...]:
    """Courses by time constants that are larger and smaller by a factor; none but of time."""
    if course.time_constant is None or math.isinf(course.time_constant):
        return ()
    passed = part_passed(shots)
    near = (course.time_constant * factor, course.time_constant / factor)
    return tuple(Course.by_time(passed, each) for each in near)


def by_temperature(shots: Shots) -> bool:
    """Whether parts' temperatures were measured, and changed by what shows growth."""
    known = shots.part_temperature_degC[np.isfinite(shots.part_temperature_degC)]
    return len(known) > 1 and bool(np.ptp(known) >= LEAST_DEGC)


def with_readings(shots: Shots, readings: Mapping[str, float]) -> Shots:
    """Shots with temperatures of parts by readings at times, °C, where they have none.

    Between two readings in proportion to time. Raises `ShotsInvalid` for times of another kind.
    """
    if not readings:
        return shots
    seconds, lacking = times_s([*shots.measured_utc, *readings])
    if seconds is None:
        raise ShotsInvalid(
            f"part_temperatures in campaign.yaml and the shots do not go together: {lacking}",
            remedy='give times as those of the shots, "2026-11-21T09:00:00Z"',
        )
    own, at, read = shots.part_temperature_degC, *np.split(seconds, [len(shots)])
    order = np.argsort(read, kind="stable")
    between = np.interp(at, read[order], np.array([*readings.values()])[order])
    return replace(shots, part_temperature_degC=np.where(np.isnan(own), between, own))


def part_passed(shots: Shots) -> Array:
    """Part of the run that had passed at each shot, (N,); by their order where no times tell it."""
    order, seconds = shots.order_of_time(), shots.elapsed_s()
    if seconds is None or np.diff(seconds[order]).min(initial=0.0) < 0.0 or not seconds.any():
        seconds = np.argsort(order).astype(np.float64)
    return np.asarray(seconds / max(float(seconds.max(initial=0.0)), 1e-9))


def _moved(shots: Shots, passed: Array) -> Array | None:
    """Course by the visits of the drift pose, (N,); None where it moved along no line."""
    visits = shots.rows_of(ShotSet.DRIFT)
    if len(visits) < FEWEST_VISITS:
        return None
    visits = visits[np.argsort(passed[visits], kind="stable")]
    moved = shots.points_in_tracker_mm[visits] - shots.points_in_tracker_mm[visits[-1]]
    _, sizes, axes = np.linalg.svd(moved - moved.mean(axis=0))
    if sizes[0] <= ALONG * sizes[1]:
        return None
    along = moved @ axes[0]
    along = -along / along[np.argmax(np.abs(along))]
    return np.asarray(np.interp(passed, passed[visits], along))
