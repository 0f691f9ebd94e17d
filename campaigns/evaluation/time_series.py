"""Time series: what changed while it was measured, the air and the place of the drift pose."""

from dataclasses import dataclass
from datetime import datetime

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots


@dataclass(frozen=True, slots=True, eq=False)
class TimeSeries:
    """Temperature and drift of a series over its time, counted from its first shot."""

    name: str
    temperature_s: Array
    """When each temperature was read."""
    temperature_degC: Array
    drift_s: Array
    drift_mm: Array
    """Distance of each drift shot from the first one."""

    @property
    def longest_s(self) -> float:
        """When the last value was read."""
        return float(max(self.temperature_s.max(initial=0.0), self.drift_s.max(initial=0.0)))

    @property
    def is_empty(self) -> bool:
        """Whether it says nothing at all."""
        return len(self.temperature_degC) == 0 and len(self.drift_mm) < 2


def time_series(name: str, shots: Shots) -> TimeSeries:
    """Time series of shots, in the order in which they were measured."""
    at_s = _seconds(shots)
    order = np.argsort(at_s, kind="stable")
    known = _where(order, ~np.isnan(shots.temperature_degC))
    drift = _where(order, np.array([each is ShotSet.DRIFT for each in shots.purposes]))
    points = shots.points_in_tracker_mm[drift]
    return TimeSeries(
        name,
        at_s[known],
        shots.temperature_degC[known],
        at_s[drift],
        np.linalg.norm(points - points[:1], axis=1),
    )


def _where(order: Index, chosen: Array) -> Index:
    return np.asarray(order[chosen[order]])


def _seconds(shots: Shots) -> Array:
    times = [datetime.fromisoformat(text) for text in shots.measured_utc]
    first = min(times)
    return np.array([(time - first).total_seconds() for time in times], dtype=np.float64)
