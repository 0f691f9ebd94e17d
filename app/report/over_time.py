"""What changed while it was measured: the air, and the place of the drift pose."""

from dataclasses import dataclass
from datetime import datetime

import numpy as np

from app.report.evidence import MeasuredSeries
from campaigns.arrays import Array
from campaigns.journal.views import AcceptedShot
from campaigns.shots.shot_sets import ShotSet


@dataclass(frozen=True, slots=True, eq=False)
class TimeSeries:
    """A series over its time, counted from its first shot."""

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


def time_series(name: str, measured: MeasuredSeries) -> TimeSeries:
    """Read it off the shots, in the order in which they were measured."""
    shots = sorted(measured.shots, key=lambda shot: shot.measured_utc)
    with_air = [(shot, shot.outcome.weather) for shot in shots]
    known = [(shot, air.temperature_degC) for shot, air in with_air if air is not None]
    drift = [shot for shot in shots if shot.intent.purpose == ShotSet.DRIFT.value]
    points = np.array([s.outcome.point_in_tracker_mm for s in drift]).reshape(-1, 3)
    return TimeSeries(
        name,
        _seconds([shot for shot, _ in known], shots[0]),
        np.array([temperature for _, temperature in known]),
        _seconds(drift, shots[0]),
        np.linalg.norm(points - points[:1], axis=1),
    )


def _seconds(shots: list[AcceptedShot], first: AcceptedShot) -> Array:
    start = datetime.fromisoformat(first.measured_utc)
    return np.array(
        [(datetime.fromisoformat(shot.measured_utc) - start).total_seconds() for shot in shots],
        dtype=np.float64,
    )
