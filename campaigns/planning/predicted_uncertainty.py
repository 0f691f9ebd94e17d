"""Predicted uncertainty of parameters and of positions, before anything has moved."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array
from campaigns.design.exchange import Unobservable, check_observable
from campaigns.design.pose_sampling import sample_workspace
from campaigns.design.restricted_space import RestrictedSpace
from campaigns.design.tours import positive_approach_shares
from campaigns.errors import ConfigInvalid, PlanInvalid
from campaigns.estimation import tracker_noise
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.information import (
    LEAST_SHARE,
    Uncertainty,
    WorkspaceSample,
    common_by_distances,
    common_by_points,
    predict_distances,
    predict_points,
)
from campaigns.estimation.observability import Observability
from campaigns.estimation.residuals import FRAME_COLUMNS
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.transmission import GAIN
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import PlanRequest, View, joints_of, make_plan, pairs_of, poses_of
from campaigns.robots.robot import RobotFile
from campaigns.shots.shot_sets import ShotSet


@dataclass(frozen=True, slots=True)
class EstimationSetup:
    """Estimator, free parameters, and the tracker's stated uncertainty."""

    estimator: Estimator
    free: tuple[str, ...]
    uncertainty: tracker_noise.TrackerUncertainty


@dataclass(frozen=True, slots=True, eq=False)
class Forecast:
    """Standard uncertainty that so many shots will give, of parameters and of positions."""

    shots: int
    predicted: Uncertainty
    position_std_mm: Array
    """Of positions of the workspace's sample, the frame best fitted, (N,): the random part."""
    total_position_std_mm: Array | None = None
    """A plan's with errors common to all shots; None of a number of shots on a curve."""
    seen: Observability | None = None
    """What a plan's shots see of the parameters alone; None of a number of shots on a curve."""
    from_below: tuple[float, ...] = ()
    """Share of a plan's shots to which each joint comes from a smaller value, (n,)."""
    ratio_std_ppm: float = 0.0
    """Of an encoder's ratio, the worst, were all to be found too; infinite where none can be."""

    @classmethod
    def of(cls, shots: int, predicted: Uncertainty, sample: WorkspaceSample) -> "Forecast":
        """Forecast of a number of shots."""
        return cls(shots, predicted, predicted.random.of_positions(sample))


def plan_forecast(
    shots: Sequence[PlannedShot],
    kinematics: Kinematics,
    tracker_mm: Array,
    setup: EstimationSetup,
    sample: WorkspaceSample,
) -> Forecast:
    """Forecast of a plan by the nominal robot and the tracker's place (3,) in the base frame."""
    predicted, seen = predicted_uncertainty(shots, kinematics, tracker_mm, setup)
    counted = sum(shot.purpose is ShotSet.IDENTIFICATION for shot in shots)
    predicted = with_common_errors(predicted, shots, kinematics, tracker_mm, setup)
    found = Forecast.of(counted, predicted, sample)
    return replace(
        found,
        total_position_std_mm=predicted.of_positions(sample),
        seen=seen,
        from_below=plan_approach_shares(shots),
        ratio_std_ppm=_ratio_std_ppm(shots, kinematics, tracker_mm, setup),
    )


def _ratio_std_ppm(
    shots: Sequence[PlannedShot], kinematics: Kinematics, tracker_mm: Array, setup: EstimationSetup
) -> float:
    """Standard uncertainty of the worst encoder's ratio beside all that a plan is for."""
    space = kinematics.mechanism.parameters
    ratios = tuple(name for name in space.transmission if space[name].field.stem == GAIN.stem)
    free = (*(name for name in setup.free if name not in ratios), *ratios)
    beside = replace(setup, free=free)
    found, _ = predicted_uncertainty(shots, kinematics, tracker_mm, beside)
    return max(found.std()[name] for name in ratios)


def predicted_uncertainty(
    shots: Sequence[PlannedShot], kinematics: Kinematics, tracker_mm: Array, setup: EstimationSetup
) -> tuple[Uncertainty, Observability]:
    """Uncertainty by the identification shots of a plan, if they scatter as stated."""
    joints, poses = joints_of(shots), poses_of(shots)
    pairs, free = pairs_of(shots, ShotSet.IDENTIFICATION), setup.free
    noise = tracker_noise.point_covariance_mm2(poses[:, :3] - tracker_mm, setup.uncertainty)
    if setup.estimator is Estimator.POINTS:
        rows = pairs.ravel()
        found, seen = predict_points(kinematics, free, joints[rows], poses[rows], noise[rows])
    else:
        variance = tracker_noise.distance_variance_mm2(
            poses[:, :3], noise, pairs[:, 0], pairs[:, 1]
        )
        alike = np.full(len(pairs), tracker_noise.pooled_variance_mm2(variance))
        found, seen = predict_distances(kinematics, free, joints, poses, pairs, alike)
    units, count = kinematics.mechanism.parameters.units(free), len(free)
    return Uncertainty.of(free, units, found[:count, :count], source="predicted"), seen


def fewest_shots(robot: RobotFile, view: View, request: PlanRequest, setup: EstimationSetup) -> int:
    """Return the least even number of boundary shots that determine all free parameters."""
    most = 2 * (len(setup.free) + FRAME_COLUMNS)
    many = replace(request, identification_shots=most, validation_pairs=0)
    made = make_plan(robot, view, many, np.random.default_rng(1))
    tracker_mm = np.array(view.tracker_mm)
    pairs = sorted({shot.pair for shot in made if shot.pair is not None})
    for count in range(1, len(pairs)):
        some = [shot for shot in made if shot.pair in pairs[:count]]
        known, _ = predicted_uncertainty(some, robot.kinematics, tracker_mm, setup)
        if known.full_rank:
            return 2 * count
    return most


def with_common_errors(
    predicted: Uncertainty,
    shots: Sequence[PlannedShot],
    kinematics: Kinematics,
    tracker_mm: Array,
    setup: EstimationSetup,
) -> Uncertainty:
    """The same with errors common to all shots of a plan, as an identification will state them.

    The instrument stands upright in the base frame. Not of parameters that are not all known.
    """
    if not predicted.full_rank:
        return predicted
    joints, poses = joints_of(shots), poses_of(shots)
    pairs, free = pairs_of(shots, ShotSet.IDENTIFICATION), setup.free
    seen_mm = poses[:, :3] - tracker_mm
    shifts = tracker_noise.common_shifts_mm(seen_mm, setup.uncertainty)
    if setup.estimator is Estimator.POINTS:
        rows = pairs.ravel()
        noise = tracker_noise.point_covariance_mm2(seen_mm[rows], setup.uncertainty)
        own = {name: each[rows] for name, each in shifts.items()}
        found = common_by_points(kinematics, free, joints[rows], poses[rows], noise, own)
    else:
        found = common_by_distances(kinematics, free, joints, poses, pairs, shifts)
    units = kinematics.mechanism.parameters.units(free)
    common = {name: tuple((each / units).tolist()) for name, each in found.items()}
    return replace(predicted, common=common)


def plan_approach_shares(shots: Sequence[PlannedShot]) -> tuple[float, ...]:
    """Share of identification shots to which each joint comes from a smaller value, (n,).

    Ways are taken as straight; the first shot is reached from its own joints.
    """
    joints = joints_of(shots)
    counted = np.array([shot.purpose is ShotSet.IDENTIFICATION for shot in shots])
    return tuple(positive_approach_shares(joints, joints[0], counted).tolist())


def judged_positions(
    robot: RobotFile,
    centre: Array,
    space: RestrictedSpace,
    free: tuple[str, ...],
    shots: Sequence[PlannedShot],
) -> WorkspaceSample:
    """Positions that are judged, by parameters that can be told apart there.

    Raises `PlanInvalid`, and `ConfigInvalid` as `sample_positions` does.
    """
    model = RobotModel(robot.kinematics, robot.limits, centre, space)
    sample = sample_positions(model, free, shots)
    require_identifiable(sample)
    return sample


def sample_positions(
    robot: RobotModel, free: tuple[str, ...], shots: Sequence[PlannedShot]
) -> WorkspaceSample:
    """Positions all over the workspace, the same for every plan of a robot.

    At the plan's own poses where hardly any others can be taken. Raises `ConfigInvalid` for a robot
    that cannot be assembled there.
    """
    poses = sample_workspace(robot.kinematics, robot.limits, robot.centre, robot.space)
    if poses is None:
        poses = poses_of(shots).reshape(-1, len(robot.centre))
    sample = WorkspaceSample.of_workspace(robot.kinematics, free, poses)
    if sample is None:
        raise ConfigInvalid(
            f"robot.yaml: the robot can be assembled at {robot.kinematics.assembles(poses).sum()} "
            f"of {len(poses)} poses of its workspace (limit {100.0 * LEAST_SHARE:g} %)",
            remedy="correct its geometry and limits",
        )
    return sample


def require_identifiable(sample: WorkspaceSample) -> None:
    """Raise `PlanInvalid` for parameters that nothing can tell apart without a frame."""
    try:
        check_observable(sample.jacobian.reshape(-1, len(sample.names)), sample.names)
    except Unobservable as error:
        raise not_identifiable(error) from error


def not_identifiable(error: Unobservable) -> PlanInvalid:
    """Error for the operator: the parameters are not identifiable from the plan's shots."""
    return PlanInvalid(str(error), remedy="keep one of them at its nominal value, with --fix")
