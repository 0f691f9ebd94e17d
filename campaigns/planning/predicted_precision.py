"""Predicted precision: covariance of parameters and of positions before anything has moved."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array
from campaigns.design.exchange import Unobservable, check_observable
from campaigns.design.pose_sampling import (
    FeasibleRegion,
    WorkspaceTooSmall,
    workspace_poses,
)
from campaigns.design.tours import positive_approach_shares
from campaigns.errors import PlanInvalid
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.information import (
    PredictedCovariance,
    largest_std,
    position_std_mm,
    predict_distances,
    predict_points,
    workspace_jacobian,
)
from campaigns.estimation.tracker_noise import (
    TrackerUncertainty,
    distance_variance_mm2,
    point_covariance_mm2,
    pooled_variance_mm2,
)
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import Placement, joints_of, pairs_of, poses_of
from campaigns.shots.shot_sets import ShotSet

WORKSPACE_SAMPLE = 1000
"""Number of poses all over the workspace at which positions are judged."""
WORKSPACE_SEED = 1
"""Seed of these poses: they are the same ones for every plan of a robot."""


@dataclass(frozen=True, slots=True)
class EstimationSetup:
    """Estimator, free parameters, and the tracker's stated uncertainty."""

    estimator: Estimator
    free: tuple[str, ...]
    uncertainty: TrackerUncertainty


@dataclass(frozen=True, slots=True, eq=False)
class PredictedPrecision:
    """Covariance that so many shots will give of the parameters."""

    shots: int
    names: tuple[str, ...]
    units: Array
    """Factors from the units of the names (mm, deg) to inner ones, (F,)."""
    covariance: Array
    """(F, F), mm and rad; infinite when the rank is lost."""

    @property
    def full_rank(self) -> bool:
        """Whether every parameter will be known."""
        return bool(np.isfinite(self.covariance).all())

    @property
    def std(self) -> Array:
        """1 σ in mm and rad, (F,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def std_in_file_units(self) -> dict[str, float]:
        """1 σ in mm and deg, by name."""
        return dict(zip(self.names, (self.std / self.units).tolist(), strict=True))

    @property
    def worst_length_mm(self) -> float:
        """The largest σ of a length; zero where none is free."""
        return largest_std(self.std, self.names)[0]

    @property
    def worst_angle_rad(self) -> float:
        """The largest σ of an angle; zero where none is free."""
        return largest_std(self.std, self.names)[1]

    def position_std_mm(self, jacobian: Array) -> Array:
        """σ of the position where a workspace Jacobian (N, 3, F) looks, (N,)."""
        if not self.full_rank:
            return np.full(len(jacobian), np.inf)
        return position_std_mm(jacobian, self.covariance)


@dataclass(frozen=True, slots=True, eq=False)
class PrecisionCurvePoint:
    """Predicted precision of some number of shots, on a curve of several."""

    predicted: PredictedPrecision
    position_mm: float
    """Mean predicted σ of positions over the workspace."""

    @classmethod
    def of(cls, predicted: PredictedPrecision, jacobian: Array) -> "PrecisionCurvePoint":
        """Point of the curve, its position judged where a workspace Jacobian (N, 3, F) looks."""
        return cls(predicted, float(predicted.position_std_mm(jacobian).mean()))


@dataclass(frozen=True, slots=True, eq=False)
class PlanPrecision:
    """Predicted precision of a plan's identification shots."""

    predicted: PredictedPrecision
    information: PredictedCovariance
    position_std_mm: Array
    """Standard deviation of positions all over the workspace, the frame best fitted, (N,)."""
    from_below: tuple[float, ...]
    """Share of shots to which each joint comes from a smaller value, (n,)."""


@dataclass(frozen=True, slots=True, eq=False)
class PlanForecast:
    """Precision of a plan and of other numbers of shots, and how the plan was made."""

    precision: PlanPrecision
    curve: tuple[PrecisionCurvePoint, ...]
    """Empty where shots were not chosen."""
    estimator: Estimator
    placement: Placement
    criterion: str | None
    seed: int


def predict_precision(
    shots: Sequence[PlannedShot],
    kinematics: Kinematics,
    tracker_mm: Array,
    setup: EstimationSetup,
    workspace: Array,
) -> PlanPrecision:
    """Precision of a plan by the nominal robot and the tracker's place (3,) in the base frame.

    `workspace` is the Jacobian (N, 3, F) of the positions that are judged.
    """
    information = predicted_covariance(shots, kinematics, tracker_mm, setup)
    counted = sum(shot.purpose is ShotSet.IDENTIFICATION for shot in shots)
    units = kinematics.mechanism.parameters.units(setup.free)
    predicted = PredictedPrecision(counted, setup.free, units, information.covariance)
    std_mm = predicted.position_std_mm(workspace)
    return PlanPrecision(predicted, information, std_mm, plan_approach_shares(shots))


def predicted_covariance(
    shots: Sequence[PlannedShot], kinematics: Kinematics, tracker_mm: Array, setup: EstimationSetup
) -> PredictedCovariance:
    """Covariance from the identification shots of a plan, if they scatter as stated."""
    joints, poses = joints_of(shots), poses_of(shots)
    pairs = pairs_of(shots, ShotSet.IDENTIFICATION)
    noise = point_covariance_mm2(poses[:, :3] - tracker_mm, setup.uncertainty)
    if setup.estimator is Estimator.POINTS:
        rows = pairs.ravel()
        return predict_points(kinematics, setup.free, joints[rows], poses[rows], noise[rows])
    variance = distance_variance_mm2(poses[:, :3], noise, pairs[:, 0], pairs[:, 1])
    alike = np.full(len(pairs), pooled_variance_mm2(variance))
    return predict_distances(kinematics, setup.free, joints, poses, pairs, alike)


def plan_approach_shares(shots: Sequence[PlannedShot]) -> tuple[float, ...]:
    """Share of identification shots to which each joint comes from a smaller value, (n,).

    Ways are taken as straight; the first shot is reached from its own joints.
    """
    joints = joints_of(shots)
    counted = np.array([shot.purpose is ShotSet.IDENTIFICATION for shot in shots])
    return tuple(positive_approach_shares(joints, joints[0], counted).tolist())


def identifiable_workspace(kinematics: Kinematics, free: tuple[str, ...], poses: Array) -> Array:
    """Workspace Jacobian (N, 3, F); raises `PlanInvalid` for parameters that move together."""
    jacobian = workspace_jacobian(kinematics, free, poses)
    require_identifiable(jacobian, free)
    return jacobian


def sampled_workspace(
    region: FeasibleRegion, free: tuple[str, ...], shots: Sequence[PlannedShot]
) -> Array:
    """Workspace Jacobian (N, 3, F) where positions are judged, the same for every plan of a robot.

    At the plan's own poses where hardly any others can be taken. Raises `PlanInvalid`.
    """
    rng = np.random.default_rng(WORKSPACE_SEED)
    try:
        poses = workspace_poses(
            region.kinematics, region.limits, region.centre, WORKSPACE_SAMPLE, rng, region.space
        )
    except WorkspaceTooSmall:
        poses = poses_of(shots)
    return identifiable_workspace(region.kinematics, free, poses)


def require_identifiable(jacobian: Array, free: tuple[str, ...]) -> None:
    """Raise `PlanInvalid` for parameters that a Jacobian (N, 3, F) without a frame cannot tell."""
    try:
        check_observable(jacobian.reshape(-1, len(free)), free)
    except Unobservable as error:
        raise not_identifiable(error) from error


def not_identifiable(error: Unobservable) -> PlanInvalid:
    """Error for the operator: the parameters are not identifiable from the plan's shots."""
    return PlanInvalid(str(error), remedy="hold one of them at its nominal value, with --fix")
