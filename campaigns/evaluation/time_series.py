"""Time series: how the air and the place of the drift pose changed during a series."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from campaigns.arrays import Array
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

SIGNIFICANCE = 1e-3
"""Probability of a larger χ² below which scatter alone does not explain visits of a pose."""
FEWEST_VISITS = 3
"""Visits to the drift pose that scatter alone must explain before the robot counts as settled."""


@dataclass(frozen=True, slots=True, eq=False)
class TimeSeries:
    """Temperature and drift of a series over its time, counted from its first shot."""

    name: str
    temperature_s: Array
    """When each temperature was read."""
    temperature_degC: Array
    drift_s: Array
    """When each drift shot was measured."""
    drift_mm: Array
    """Distance of each drift shot from the first one."""

    @property
    def longest_s(self) -> float:
        """Time at which the last value was read."""
        return float(max(self.temperature_s.max(initial=0.0), self.drift_s.max(initial=0.0)))

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to draw: no temperature, and no second drift shot."""
        return len(self.temperature_degC) == 0 and len(self.drift_mm) < 2

    @property
    def air_range(self) -> tuple[float, float] | None:
        """Lowest and highest temperature, °C; None where none was read."""
        read = self.temperature_degC
        return (float(read.min()), float(read.max())) if len(read) else None

    @property
    def moved_mm(self) -> float | None:
        """Largest drift; None where the drift pose was not measured again."""
        return float(self.drift_mm.max()) if len(self.drift_mm) > 1 else None


def time_series(name: str, shots: Shots) -> TimeSeries:
    """Return the time series of shots, in the order in which they were measured."""
    # Imported shots may have no times: their order stands in, one second apart.
    at_s = shots.elapsed_s()
    at_s = np.arange(len(shots), dtype=np.float64) if at_s is None else at_s
    order = shots.order_of_time()
    with_temperature = order[~np.isnan(shots.temperature_degC)[order]]
    drift = np.array([row for row in order.tolist() if shots.purposes[row] is ShotSet.DRIFT], int)
    points = shots.points_in_tracker_mm[drift]
    return TimeSeries(
        name,
        at_s[with_temperature],
        shots.temperature_degC[with_temperature],
        at_s[drift],
        np.linalg.norm(points - points[:1], axis=1),
    )


def settling(
    numbers: Sequence[int], points_mm: Array, covariance_mm2: Array
) -> tuple[tuple[int, ...], str]:
    """Return numbers of the last visits to one pose that scatter alone explains, and the finding.

    Points (K, 3) with covariances (K, 3, 3) are in the order of time. Return no numbers if scatter
    does not explain even the last three visits.
    """
    # A robot that warms up moves fast at first and comes to rest. Drop the first visits one by one
    # until those that remain agree with a single place: χ² about their weighted mean, with three
    # degrees of freedom fewer than coordinates for that place. The longest such tail is returned.
    inverse = np.linalg.inv(covariance_mm2)
    for first in range(len(points_mm) - FEWEST_VISITS + 1):
        last, weight = points_mm[first:], inverse[first:]
        mean = np.linalg.solve(weight.sum(axis=0), np.einsum("nij,nj->i", weight, last))
        away = last - mean
        chi2 = np.einsum("ni,nij,nj->", away, weight, away)
        if scipy.special.chdtrc(3 * (len(last) - 1), chi2) >= SIGNIFICANCE:
            most_mm, since = np.linalg.norm(away, axis=1).max(), tuple(numbers[first:])
            says = f"no drift since shot {since[0]}: the drift pose repeats within {most_mm:.3f} mm"
            return since, says
    moved_mm = np.linalg.norm(points_mm[-1] - points_mm[-FEWEST_VISITS])
    return (), (
        f"the robot still warms up or moves: its drift pose by {moved_mm:.3f} mm in the last "
        f"{FEWEST_VISITS} visits"
    )


def worst_std_mm(covariance_mm2: Array) -> tuple[float, float]:
    """Return median and largest 1 σ of points (N, 3, 3), in each one's worst direction, mm."""
    # eigvalsh sorts ascending: the last eigenvalue is the variance along the worst direction.
    worst = np.sqrt(np.linalg.eigvalsh(covariance_mm2)[:, -1])
    return float(np.median(worst)), float(worst.max())
