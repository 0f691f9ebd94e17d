"""What each validation test shows shot by shot, with the instrument's share in its uncertainty.

Results are those of campaigns/evaluation/validation.py; here are the points behind them. Everything
is in mm, in the one frame that a `MeasuredTest` is given in.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import JsonValue

from campaigns.arrays import Array, Index
from campaigns.estimation.observability import Spread, spread
from campaigns.estimation.point_sets import (
    away_from_best_line,
    away_from_mean,
    directions,
    distances_mm,
    farthest_apart,
    fitted_frame,
    longest_mm,
    whole_pairs,
)
from campaigns.estimation.rigid_transforms import Transform
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.evaluation.decision import Requirement
from campaigns.evaluation.iso9283 import pose_repeatability
from campaigns.journal.views import AcceptedShot
from campaigns.robots.robot import pose_row
from campaigns.settings.sections import AcceptanceConfig
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import outcomes_covariance_mm2


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


AXES = ("x", "y", "z")
NO_AXIS = -1
SAME_MM = 1e-6
"""Below this a commanded coordinate has not changed."""


@dataclass(frozen=True, slots=True)
class Repeatability:
    """Many approaches to one point: radius of the sphere about their mean, and ISO 9283's RP."""

    radius_mm: float
    rp_mm: float
    approaches: int


@dataclass(frozen=True, slots=True)
class FrameErrors:
    """Distances to the commanded points after the six-parameter fit (eqs. 22-25)."""

    mean: float
    max: float


@dataclass(frozen=True, slots=True)
class Validation:
    """Results in mm; None for a test that was not run."""

    distances: Spread | None
    rotation_mm: float | None
    straightness_mm: Mapping[str, float] | None
    repeatability: Repeatability | None
    frame: FrameErrors | None

    def document(self) -> dict[str, JsonValue]:
        """As `validate --json` prints it."""
        return {
            "distances_mm": _picked(self.distances, "mean_abs", "max_abs"),
            "rotation_mm": self.rotation_mm,
            "straightness_mm": dict(self.straightness_mm) if self.straightness_mm else None,
            "repeatability": _picked(self.repeatability, "radius_mm", "rp_mm", "approaches"),
            "frame_mm": _picked(self.frame, "mean", "max"),
        }


def _picked(value: object | None, *names: str) -> JsonValue:
    return None if value is None else {name: getattr(value, name) for name in names}


def evaluate_validation(shots: Sequence[AcceptedShot]) -> Validation:
    """Evaluate the accepted shots of a validation series."""
    validation = of_set(shots, ShotSet.VALIDATION)
    return Validation(
        _distances(validation),
        rotation_mm(measured_points(of_set(shots, ShotSet.ROTATION))),
        _straightness(of_set(shots, ShotSet.STRAIGHTNESS)),
        repeatability(measured_points(of_set(shots, ShotSet.REPEATABILITY))),
        frame_errors(commanded_poses(validation)[:, :3], measured_points(validation)),
    )


def of_set(shots: Sequence[AcceptedShot], purpose: ShotSet) -> tuple[AcceptedShot, ...]:
    """The shots of one test."""
    return tuple(shot for shot in shots if shot.intent.purpose == purpose.value)


def measured_points(shots: Sequence[AcceptedShot]) -> Array:
    """Measured, in the tracker's frame, mm, (N, 3)."""
    return np.array([shot.outcome.point_in_tracker_mm for shot in shots]).reshape(-1, 3)


def commanded_poses(shots: Sequence[AcceptedShot]) -> Array:
    """Commanded, X, Y, Z in mm in the base frame and θ in rad, (N, 4)."""
    return np.array([pose_row(shot.intent.target) for shot in shots]).reshape(-1, 4)


def _distances(shots: Sequence[AcceptedShot]) -> Spread | None:
    """Commanded minus measured distances of the pairs."""
    pairs, first, second = whole_pairs([shot.intent.pair for shot in shots])
    if not pairs:
        return None
    commanded = distances_mm(commanded_poses(shots)[:, :3], first, second)
    return spread(commanded - distances_mm(measured_points(shots), first, second))


def rotation_mm(points: Array) -> float | None:
    """Largest distance between any two points (N, 3) measured while only θ should change."""
    if len(points) < 2:
        return None
    first, second = farthest_apart(points)
    return float(np.linalg.norm(points[first] - points[second]))


def _straightness(shots: Sequence[AcceptedShot]) -> dict[str, float] | None:
    """By the axis along which each line was commanded; a line needs three points."""
    points, axes = measured_points(shots), line_axes(commanded_poses(shots)[:, :3])
    lines = {name: points[axes == axis] for axis, name in enumerate(AXES)}
    found = {name: straightness_mm(line) for name, line in lines.items() if len(line) > 2}
    return found or None


def line_axes(commanded_mm: Array) -> Index:
    """The axis (0, 1, 2) of the line to which each commanded point belongs, (N,).

    Points (N, 3) come line by line, and along each line only one coordinate changes: a point is of
    the line of its predecessor as long as it differs from it along one axis alone.
    """
    steps = np.abs(np.diff(commanded_mm, axis=0)) > SAME_MM
    axes = np.full(len(commanded_mm), NO_AXIS, dtype=np.intp)
    for row, changed in enumerate(steps, start=1):
        if np.count_nonzero(changed) == 1:
            axes[row] = int(np.argmax(changed))
            if axes[row - 1] == NO_AXIS:
                axes[row - 1] = axes[row]
    return axes


def straightness_mm(points: Array) -> float:
    """Largest distance of points (N, 3) from their best line."""
    return longest_mm(away_from_best_line(points))


def repeatability(points: Array) -> Repeatability | None:
    """Of points (N, 3) measured at one commanded pose; None for fewer than two."""
    if len(points) < 2:
        return None
    radius_mm = longest_mm(away_from_mean(points))
    return Repeatability(radius_mm, pose_repeatability(points).value_mm, len(points))


def frame_errors(commanded_in_base_mm: Array, measured_in_tracker_mm: Array) -> FrameErrors | None:
    """Absolute accuracy in the tracker's frame; None for points that don't fix one well."""
    tracker_from_base = fitted_frame(commanded_in_base_mm, measured_in_tracker_mm)
    if tracker_from_base is None:
        return None
    away = tracker_from_base.apply(commanded_in_base_mm) - measured_in_tracker_mm
    lengths = np.linalg.norm(away, axis=1)
    return FrameErrors(float(lengths.mean()), float(lengths.max()))


def broken_limits(found: Validation, limits: AcceptanceConfig) -> list[str]:
    """Every acceptance limit that the results break as they stand, with value and limit."""
    return [
        f"{each.name} {each.error:.3f} mm, limit {each.limit:g} mm"
        for each in _requirements(found, limits)
        if each.decision == "fail"
    ]


def _requirements(found: Validation, limits: AcceptanceConfig) -> tuple[Requirement, ...]:
    distances, repeated = found.distances, found.repeatability
    straight = found.straightness_mm
    mean, largest = (distances.mean_abs, distances.max_abs) if distances else (None, None)
    worst_line = max(straight.values()) if straight else None
    radius = repeated.radius_mm if repeated else None
    return (
        Requirement("mean distance error", mean, limits.distance_mean_mm),
        Requirement("largest distance error", largest, limits.distance_max_mm),
        Requirement("rotation", found.rotation_mm, limits.rotation_mm),
        Requirement("straightness", worst_line, limits.straightness_mm),
        Requirement("repeatability", radius, limits.repeatability_mm),
    )
