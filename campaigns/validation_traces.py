"""What each validation test shows shot by shot, with the instrument's share in its uncertainty.

Results are those of campaigns/validate.py; here are the points behind them. Everything is in mm, in
the one frame that a `MeasuredTest` is given in.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.journal_views import AcceptedShot
from campaigns.numerics.frames import Transform, fit_transform
from campaigns.numerics.geometry import Array, Index
from campaigns.numerics.instrument import TrackerUncertainty, point_covariance_mm2
from campaigns.numerics.pairs import directions, distances_mm
from campaigns.planning import pose_row
from campaigns.shot_sets import ShotSet
from campaigns.validate import AXES, SHOTS_FOR_A_FRAME, line_axes


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


def of_set(shots: Sequence[AcceptedShot], purpose: ShotSet) -> tuple[AcceptedShot, ...]:
    """The shots of one test."""
    return tuple(shot for shot in shots if shot.intent.purpose == purpose.value)


def measured_test(shots: Sequence[AcceptedShot], model: TrackerUncertainty) -> MeasuredTest:
    """Shots with their measured points in the tracker's frame.

    Shots without a covariance of their own get that of `model`.
    """
    points = np.array([shot.outcome.point_in_tracker_mm for shot in shots]).reshape(-1, 3)
    return MeasuredTest(
        tuple(shot.intent.pair for shot in shots),
        np.array([pose_row(shot.intent.target) for shot in shots]).reshape(-1, 4),
        points,
        stated_covariance_mm2(shots, points, model),
    )


def stated_covariance_mm2(
    shots: Sequence[AcceptedShot], points_in_tracker_mm: Array, model: TrackerUncertainty
) -> Array:
    """What the tracker states of each point, or `model` where it states nothing, (N, 3, 3)."""
    covariance = point_covariance_mm2(points_in_tracker_mm, model)
    for row, shot in enumerate(shots):
        if shot.outcome.covariance_mm2 is not None:
            covariance[row] = shot.outcome.covariance_mm2
    return covariance


def base_from_tracker(shots: MeasuredTest) -> Transform | None:
    """The base frame that fits the commanded points best (eq. 25); None with too few for one."""
    if len(shots) < SHOTS_FOR_A_FRAME:
        return None
    try:
        return fit_transform(shots.points_mm, shots.commanded[:, :3])
    except ValueError:  # the points lie on one line
        return None


def distance_trace(shots: MeasuredTest) -> DistanceTrace | None:
    """The whole pairs; None when there is none."""
    rows: dict[int, list[int]] = {}
    for row, pair in enumerate(shots.pairs):
        if pair is not None:
            rows.setdefault(pair, []).append(row)
    whole = {pair: both for pair, both in rows.items() if len(both) == 2}
    if not whole:
        return None
    first, second = np.array(list(whole.values()), dtype=np.intp).T
    direction = directions(shots.points_mm, first, second)
    covariance = shots.covariance_mm2[first] + shots.covariance_mm2[second]
    return DistanceTrace(
        tuple(whole),
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
    lengths = np.linalg.norm(shots.points_mm[:, None] - shots.points_mm[None], axis=2)
    first, second = np.unravel_index(int(np.argmax(lengths)), lengths.shape)
    together = shots.covariance_mm2[first] + shots.covariance_mm2[second]
    return _result(shots.points_mm[first] - shots.points_mm[second], together)


def radius_result(shots: MeasuredTest) -> Result | None:
    """Radius of the sphere about the mean of points measured at one commanded pose."""
    if len(shots) < 2:
        return None
    away = shots.points_mm - shots.points_mm.mean(axis=0)
    return _largest(away, shots.covariance_mm2)


def _line_trace(axis: str, shots: MeasuredTest) -> LineTrace:
    centred = shots.points_mm - shots.points_mm.mean(axis=0)
    direction = np.linalg.svd(centred)[2][0]
    away = centred - np.outer(centred @ direction, direction)
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
