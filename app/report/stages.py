"""A validation series, before or after, as the page shows it."""

from dataclasses import dataclass

import numpy as np

from app.report.evidence import MeasuredSeries
from campaigns.arrays import Array
from campaigns.estimation.rigid_transforms import Transform
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.evaluation.validation import (
    DistanceTrace,
    LineTrace,
    MeasuredTest,
    Result,
    base_from_tracker,
    distance_trace,
    line_traces,
    measured_test,
    of_set,
    radius_result,
    rotation_result,
)
from campaigns.shots.shot_sets import ShotSet


@dataclass(frozen=True, slots=True, eq=False)
class RotationTest:
    """The point while only θ should change."""

    theta_rad: Array
    away_mm: Array
    """From the mean, (N, 3)."""
    moved: Result


@dataclass(frozen=True, slots=True, eq=False)
class RepeatabilityTest:
    """The points of repeated visits to one commanded point (3,), (N, 3)."""

    commanded_mm: Array
    points_mm: Array
    radius: Result

    @property
    def away_mm(self) -> Array:
        """From their mean, (N, 3)."""
        return np.asarray(self.points_mm - self.points_mm.mean(axis=0))


@dataclass(frozen=True, slots=True, eq=False)
class StageView:
    """What a stage shows; None or empty for a test without enough shots.

    Vectors are in the base frame as fitted to the commanded points, or, with too few of them, in
    the tracker's axes.
    """

    measured: MeasuredSeries
    in_base: bool
    distances: DistanceTrace | None
    absolute_mm: Array | None
    """Distances of the validation points from where they were commanded, (N,)."""
    turn: RotationTest | None
    lines: tuple[LineTrace, ...]
    cloud: RepeatabilityTest | None

    def line(self, axis: str) -> LineTrace | None:
        """The line along an axis."""
        return next((line for line in self.lines if line.axis == axis), None)


def stage_view(measured: MeasuredSeries, instrument: TrackerUncertainty) -> StageView:
    """Evaluate a series."""
    everything = measured_test(measured.shots, instrument)
    frame = _frame(measured, everything, instrument)

    def test(purpose: ShotSet) -> MeasuredTest:
        shots = measured_test(of_set(measured.shots, purpose), instrument)
        return shots if frame is None else shots.seen_from(frame)

    distances = test(ShotSet.VALIDATION)
    return StageView(
        measured,
        frame is not None,
        distance_trace(distances),
        None if frame is None or len(distances) == 0 else _absolute(distances),
        _turn(test(ShotSet.ROTATION)),
        line_traces(test(ShotSet.STRAIGHTNESS)),
        _cloud(test(ShotSet.REPEATABILITY)),
    )


def _frame(
    measured: MeasuredSeries, everything: MeasuredTest, instrument: TrackerUncertainty
) -> Transform | None:
    """From the validation points as in eq. 25, or from all shots where there are none."""
    validation = measured_test(of_set(measured.shots, ShotSet.VALIDATION), instrument)
    return base_from_tracker(validation) or base_from_tracker(everything)


def _absolute(shots: MeasuredTest) -> Array:
    return np.asarray(np.linalg.norm(shots.points_mm - shots.commanded[:, :3], axis=1))


def _turn(shots: MeasuredTest) -> RotationTest | None:
    moved = rotation_result(shots)
    if moved is None:
        return None
    return RotationTest(
        shots.commanded[:, 3], shots.points_mm - shots.points_mm.mean(axis=0), moved
    )


def _cloud(shots: MeasuredTest) -> RepeatabilityTest | None:
    radius = radius_result(shots)
    if radius is None:
        return None
    return RepeatabilityTest(shots.commanded[0, :3], shots.points_mm, radius)
