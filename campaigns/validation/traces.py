"""What each validation test shows shot by shot, with the instrument's share in its uncertainty.

Results are those of campaigns/validation/validate.py; here are the points behind them. Everything
is in mm, in the one frame that a `MeasuredTest` is given in.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.journal.views import AcceptedShot
from campaigns.numerics.frames import Transform
from campaigns.numerics.geometry import Array, Index
from campaigns.numerics.instrument import TrackerUncertainty
from campaigns.numerics.pairs import directions, distances_mm
from campaigns.shots.dataset import outcomes_covariance_mm2
from campaigns.shots.point_sets import (
    away_from_best_line,
    away_from_mean,
    farthest_apart,
    fitted_frame,
    whole_pairs,
)
from campaigns.validation.validate import AXES, commanded_poses, line_axes, measured_points


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredTest:
    """Shots by their numbers: what was commanded (base frame) and what was measured."""

    pairs: tuple[int | None, ...]
    commanded: Array
    """X, Y, Z in mm and θ in rad, (N, 4)."""
    points_mm: Array
    """(N, 3)"""
    covariance_mm2: Array
    """(N, 3, 3)"""

    def __len__(self) -> int:
        return len(self.pairs)

    def rows(self, rows: Index) -> "MeasuredTest":
        """Some of them."""
        return MeasuredTest(
            tuple(self.pairs[row] for row in rows.tolist()),
            self.commanded[rows],
            self.points_mm[rows],
            self.covariance_mm2[rows],
        )

    def seen_from(self, other_from_this: Transform) -> "MeasuredTest":
        """With the measured points in another frame."""
        rotation = other_from_this.rotation
        covariance = rotation @ self.covariance_mm2 @ rotation.T
        points = other_from_this.apply(self.points_mm)
        return MeasuredTest(self.pairs, self.commanded, points, covariance)


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """A length, and the instrument's standard uncertainty in the direction in which it lies."""

    value_mm: float
    instrument_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class DistanceTrace:
    """Pairs whose distance was commanded and measured, (M,) each."""

    pairs: tuple[int, ...]
    commanded_mm: Array
    measured_mm: Array
    instrument_mm: Array

    @property
    def errors_mm(self) -> Array:
        """Commanded minus measured."""
        return np.asarray(self.commanded_mm - self.measured_mm)


@dataclass(frozen=True, slots=True, eq=False)
class LineTrace:
    """One commanded straight line, (N, 3) each."""

    axis: str
    commanded_mm: Array
    points_mm: Array
    away_mm: Array
    """From the best line to the measured points."""
    straightness: Result

    @property
    def along_mm(self) -> Array:
        """Commanded place along the line, (N,)."""
        return np.asarray(self.commanded_mm[:, AXES.index(self.axis)])


def measured_test(shots: Sequence[AcceptedShot], model: TrackerUncertainty) -> MeasuredTest:
    """Shots with their measured points in the tracker's frame.

    Shots without a covariance of their own get that of `model`.
    """
    return MeasuredTest(
        tuple(shot.intent.pair for shot in shots),
        commanded_poses(shots),
        measured_points(shots),
        outcomes_covariance_mm2([shot.outcome for shot in shots], model),
    )


def base_from_tracker(shots: MeasuredTest) -> Transform | None:
    """The base frame that fits the commanded points best (eq. 25); None with too few for one."""
    return fitted_frame(shots.points_mm, shots.commanded[:, :3])


def distance_trace(shots: MeasuredTest) -> DistanceTrace | None:
    """The whole pairs; None when there is none."""
    pairs, first, second = whole_pairs(shots.pairs)
    if not pairs:
        return None
    direction = directions(shots.points_mm, first, second)
    covariance = shots.covariance_mm2[first] + shots.covariance_mm2[second]
    return DistanceTrace(
        pairs,
        distances_mm(shots.commanded[:, :3], first, second),
        distances_mm(shots.points_mm, first, second),
        np.sqrt(np.einsum("mi,mij,mj->m", direction, covariance, direction)),
    )


def line_traces(shots: MeasuredTest) -> tuple[LineTrace, ...]:
    """Every line of at least three shots, in the order x, y, z."""
    along = line_axes(shots.commanded[:, :3])
    lines = [np.flatnonzero(along == axis) for axis in range(len(AXES))]
    return tuple(
        _line_trace(axis, shots.rows(rows))
        for axis, rows in zip(AXES, lines, strict=True)
        if len(rows) > 2
    )


def rotation_result(shots: MeasuredTest) -> Result | None:
    """Largest distance between any two points measured while only θ should change."""
    if len(shots) < 2:
        return None
    first, second = farthest_apart(shots.points_mm)
    together = shots.covariance_mm2[first] + shots.covariance_mm2[second]
    return _result(shots.points_mm[first] - shots.points_mm[second], together)


def radius_result(shots: MeasuredTest) -> Result | None:
    """Radius of the sphere about the mean of points measured at one commanded pose."""
    if len(shots) < 2:
        return None
    return _largest(away_from_mean(shots.points_mm), shots.covariance_mm2)


def _line_trace(axis: str, shots: MeasuredTest) -> LineTrace:
    away = away_from_best_line(shots.points_mm)
    straightness = _largest(away, shots.covariance_mm2)
    return LineTrace(axis, shots.commanded[:, :3], shots.points_mm, away, straightness)


def _largest(away_mm: Array, covariance_mm2: Array) -> Result:
    """The longest of vectors (N, 3)."""
    worst = int(np.argmax(np.linalg.norm(away_mm, axis=1)))
    return _result(away_mm[worst], covariance_mm2[worst])


def _result(vector_mm: Array, covariance_mm2: Array) -> Result:
    """The length of a vector (3,) and its standard deviation; for none, that of the worst axis."""
    length = float(np.linalg.norm(vector_mm))
    if length == 0.0:
        return Result(0.0, float(np.sqrt(np.linalg.eigvalsh(covariance_mm2)[-1])))
    along = vector_mm / length
    return Result(length, float(np.sqrt(along @ covariance_mm2 @ along)))
