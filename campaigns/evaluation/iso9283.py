"""Figures of ISO 9283, each by its symbol, with the number of repetitions it rests on.

Points are in mm in one frame, the commanded ones too. `instrument_mm` is the standard uncertainty
that repeating does not reduce. A spread that one repetition cannot show is not in the uncertainty.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np

from campaigns.arrays import Array
from campaigns.evaluation.decision import COVERAGE

Symbol = Literal["AP", "RP", "vAP", "AD", "RD", "AT"]

DEVIATIONS = 3.0
"""Standard deviations in RP and RD."""


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure. `n` counts repetitions: visits, or cycles of a path."""

    symbol: Symbol
    value_mm: float
    standard_uncertainty_mm: float
    n: int

    @property
    def expanded_uncertainty_mm(self) -> float:
        """U, k = 2."""
        return COVERAGE * self.standard_uncertainty_mm


def pose_accuracy(commanded_mm: Array, attained_mm: Array, instrument_mm: float) -> Figure:
    """AP (7.2.1): distance of the mean of (N, 3) attained points from the commanded one, (3,)."""
    _require(len(attained_mm), 1, "AP")
    away = attained_mm.mean(axis=0) - commanded_mm
    value = float(np.linalg.norm(away))
    scatter = _scatter_of_mean(attained_mm, away)
    return Figure("AP", value, float(np.hypot(scatter, instrument_mm)), len(attained_mm))


def pose_repeatability(attained_mm: Array) -> Figure:
    """RP = l̄ + 3 S_l (7.2.2) of (N, 3) points attained from one direction of approach.

    The instrument's noise is part of the spread; what is uncertain is the finite sample.
    """
    count = len(attained_mm)
    _require(count, 2, "RP")
    lengths = np.linalg.norm(attained_mm - attained_mm.mean(axis=0), axis=1)
    deviation = float(lengths.std(ddof=1))
    value = float(lengths.mean()) + DEVIATIONS * deviation
    relative = np.sqrt(1.0 / count + DEVIATIONS**2 / (2.0 * (count - 1)))
    return Figure("RP", value, deviation * float(relative), count)


def pose_accuracy_variation(by_direction_mm: Sequence[Array], instrument_mm: float) -> Figure:
    """VAP (7.2.3): largest distance between the means of points attained from each direction.

    One array (N, 3) a direction; the standard asks for three directions at right angles. `n` is
    that of the direction with the fewest visits.
    """
    _require(len(by_direction_mm), 2, "vAP", "directions")
    count = min(len(points) for points in by_direction_mm)
    _require(count, 1, "vAP")
    first, second = max(combinations(by_direction_mm, 2), key=_apart)
    away = first.mean(axis=0) - second.mean(axis=0)
    parts = (_scatter_of_mean(first, away), _scatter_of_mean(second, away), instrument_mm)
    return Figure("vAP", float(np.linalg.norm(away)), float(np.linalg.norm(parts)), count)


def distance_accuracy(commanded_mm: float, attained_mm: Array, instrument_mm: float) -> Figure:
    """AD = D̄ − D_c (7.3), with its sign, of distances (N,) between two commanded points."""
    count = len(attained_mm)
    _require(count, 1, "AD")
    scatter = float(attained_mm.std(ddof=1)) / np.sqrt(count) if count > 1 else 0.0
    value = float(attained_mm.mean()) - commanded_mm
    return Figure("AD", value, float(np.hypot(scatter, instrument_mm)), count)


def distance_repeatability(attained_mm: Array) -> Figure:
    """RD = ± 3 S_D (7.3) of distances (N,) between two commanded points; the value is 3 S_D."""
    count = len(attained_mm)
    _require(count, 2, "RD")
    value = DEVIATIONS * float(attained_mm.std(ddof=1))
    return Figure("RD", value, value / float(np.sqrt(2.0 * (count - 1))), count)


def line_accuracy(
    start_mm: Array, end_mm: Array, attained_mm: Array, instrument_mm: float
) -> Figure:
    """AT (8.2) of a straight path: largest distance of the mean path from the commanded line.

    `attained_mm` is (cycles, points, 3).
    """
    cycles = len(attained_mm)
    _require(cycles, 1, "AT")
    direction = (end_mm - start_mm) / np.linalg.norm(end_mm - start_mm)
    from_start = attained_mm.mean(axis=0) - start_mm
    away = from_start - np.outer(from_start @ direction, direction)
    lengths = np.linalg.norm(away, axis=1)
    worst = int(np.argmax(lengths))
    scatter = _scatter_of_mean(attained_mm[:, worst], away[worst])
    uncertainty = float(np.hypot(scatter, instrument_mm))
    return Figure("AT", float(lengths[worst]), uncertainty, cycles)


def _scatter_of_mean(points_mm: Array, along: Array) -> float:
    """Standard deviation of the mean of points (N, 3) in a direction; 0 for a single point."""
    length = float(np.linalg.norm(along))
    if len(points_mm) < 2 or length == 0.0:
        return 0.0
    return float((points_mm @ (along / length)).std(ddof=1) / np.sqrt(len(points_mm)))


def _apart(pair: tuple[Array, Array]) -> float:
    return float(np.linalg.norm(pair[0].mean(axis=0) - pair[1].mean(axis=0)))


def _require(count: int, least: int, symbol: Symbol, what: str = "repetitions") -> None:
    if count < least:
        raise ValueError(f"{symbol} needs at least {least} {what}, there are {count}")
