"""What a plan will tell before anything has moved: parameters, and positions in the workspace."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.design.exchange import Unobservable, check_observable
from campaigns.design.tours import positive_approach_shares
from campaigns.errors import PlanInvalid
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.information import (
    PredictedCovariance,
    distance_jacobian,
    marginalise_frame,
    point_jacobian,
    points_covariance,
    position_std_mm,
    predict_distances,
    predict_points,
)
from campaigns.estimation.observability import covariance, largest_std
from campaigns.estimation.tracker_noise import (
    TrackerUncertainty,
    distance_variance_mm2,
    point_covariance_mm2,
    pooled_variance_mm2,
)
from campaigns.mechanisms.geometry import FILE_UNIT, Geometry, indices
from campaigns.mechanisms.par4 import inverse
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import joints_of, pairs_of, poses_of
from campaigns.shots.shot_sets import ShotSet

WORKSPACE_SAMPLE = 1000
"""At so many poses all over the workspace positions are judged."""


@dataclass(frozen=True, slots=True)
class EstimationSetup:
    """By what the parameters will be known."""

    estimator: Estimator
    free: tuple[str, ...]
    uncertainty: TrackerUncertainty


@dataclass(frozen=True, slots=True, eq=False)
class PredictedPrecision:
    """How well so many shots will tell the parameters."""

    shots: int
    names: tuple[str, ...]
    covariance: Array
    """(F, F), mm and rad; infinite when they cannot tell all."""

    @property
    def tells_all(self) -> bool:
        """Whether every parameter will be known."""
        return bool(np.isfinite(self.covariance).all())

    @property
    def std(self) -> Array:
        """1 σ in mm and rad, (F,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def std_in_file_units(self) -> dict[str, float]:
        """1 σ in mm and deg, by name."""
        values = self.std / FILE_UNIT[indices(self.names)]
        return dict(zip(self.names, values.tolist(), strict=True))

    @property
    def worst_length_mm(self) -> float:
        """The largest σ of a length; zero where none is free."""
        return largest_std(self.std, self.names)[0]

    @property
    def worst_angle_rad(self) -> float:
        """The largest σ of an angle; zero where none is free."""
        return largest_std(self.std, self.names)[1]

    def position_std_mm(self, workspace_rows: Array) -> Array:
        """σ of the position where rows (N, 3, F) without a frame look, (N,)."""
        if not self.tells_all:
            return np.full(len(workspace_rows), np.inf)
        return position_std_mm(workspace_rows, self.covariance)


@dataclass(frozen=True, slots=True, eq=False)
class PrecisionCurvePoint:
    """What some number of shots would tell."""

    expected: PredictedPrecision
    position_mm: float
    """Mean predicted σ of positions over the workspace."""

    @classmethod
    def of(cls, expected: PredictedPrecision, workspace_rows: Array) -> "PrecisionCurvePoint":
        """With the position judged where rows (N, 3, F) without a frame look."""
        return cls(expected, float(expected.position_std_mm(workspace_rows).mean()))


@dataclass(frozen=True, slots=True, eq=False)
class PlanPrecision:
    """What a plan's identification shots will tell."""

    expected: PredictedPrecision
    prediction: PredictedCovariance
    position_std_mm: Array
    """Of positions all over the workspace, after a best fit of the frame, (N,)."""
    from_below: tuple[float, ...]
    """Share of shots to which each joint comes from a smaller angle, (4,)."""


def predict_precision(
    shots: Sequence[PlannedShot],
    geometry: Geometry,
    tracker_mm: Array,
    means: EstimationSetup,
    workspace_rows: Array,
) -> PlanPrecision:
    """Judge a plan by the nominal geometry and the tracker's place (3,) in the base frame."""
    prediction, covariance_matrix = _predicted(shots, geometry, tracker_mm, means)
    counted = sum(shot.purpose is ShotSet.IDENTIFICATION for shot in shots)
    expected = PredictedPrecision(counted, means.free, covariance_matrix)
    std_mm = expected.position_std_mm(workspace_rows)
    return PlanPrecision(expected, prediction, std_mm, plan_approach_shares(shots))


def plan_approach_shares(shots: Sequence[PlannedShot]) -> tuple[float, ...]:
    """Share of identification shots to which each joint comes from a smaller angle, (4,).

    Ways are taken as straight; the first shot is reached from its own joints.
    """
    joints = joints_of(shots)
    counted = np.array([shot.purpose is ShotSet.IDENTIFICATION for shot in shots])
    return tuple(positive_approach_shares(joints, joints[0], counted).tolist())


def workspace_jacobian(geometry: Geometry, free: tuple[str, ...], poses: Array) -> Array:
    """How positions all over the workspace hang on the free parameters, (N, 3, F), mm and rad.

    After a best fit of the frame. Raises `PlanInvalid` for parameters that no position tells apart.
    """
    rows = marginalise_frame(point_jacobian_at(geometry, free, poses))
    require_observable(rows, free)
    return rows


def require_observable(rows: Array, free: tuple[str, ...]) -> None:
    """Raise `PlanInvalid` for parameters that rows (N, 3, F) without a frame do not tell apart."""
    try:
        check_observable(rows.reshape(-1, len(free)), free)
    except Unobservable as error:
        raise not_identifiable(error) from error


def not_identifiable(error: Unobservable) -> PlanInvalid:
    """The same, for the operator."""
    return PlanInvalid(str(error), remedy="hold one of them at its nominal value, with --fix")


def point_jacobian_at(geometry: Geometry, free: tuple[str, ...], poses: Array) -> Array:
    """∂(point in a frame to be estimated)/∂(free parameters, frame), (N, 3, F + 6)."""
    return point_jacobian(geometry, free, inverse(geometry, poses).require(), poses)


def _predicted(
    shots: Sequence[PlannedShot], geometry: Geometry, tracker_mm: Array, means: EstimationSetup
) -> tuple[PredictedCovariance, Array]:
    """The prediction, and the covariance of the free parameters, (F, F)."""
    joints, poses = joints_of(shots), poses_of(shots)
    pairs = pairs_of(shots, ShotSet.IDENTIFICATION)
    noise = point_covariance_mm2(poses[:, :3] - tracker_mm, means.uncertainty)
    if means.estimator is Estimator.POINTS:
        rows = pairs.ravel()
        return _predicted_by_points(geometry, means.free, joints[rows], poses[rows], noise[rows])
    variance = distance_variance_mm2(poses[:, :3], noise, pairs[:, 0], pairs[:, 1])
    alike = np.full(len(pairs), pooled_variance_mm2(variance))
    return _predicted_by_distances(geometry, means.free, joints, poses, pairs, alike)


def _predicted_by_points(
    geometry: Geometry, free: tuple[str, ...], joints: Array, poses: Array, noise_mm2: Array
) -> tuple[PredictedCovariance, Array]:
    told = predict_points(geometry, free, joints, poses, noise_mm2)
    if told.rank < len(free):
        return told, _unknown_covariance(free)
    with_frame = points_covariance(geometry, free, joints, poses, noise_mm2)
    return told, with_frame[: len(free), : len(free)]


def _predicted_by_distances(
    geometry: Geometry,
    free: tuple[str, ...],
    joints: Array,
    poses: Array,
    pairs: Index,
    variance_mm2: Array,
) -> tuple[PredictedCovariance, Array]:
    told = predict_distances(geometry, free, joints, poses, pairs, variance_mm2)
    if told.rank < len(free):
        return told, _unknown_covariance(free)
    rows = distance_jacobian(geometry, free, joints, poses, pairs)
    return told, covariance(rows / np.sqrt(variance_mm2)[:, None])


def _unknown_covariance(free: tuple[str, ...]) -> Array:
    return np.full((len(free), len(free)), np.inf)
