"""Forecast of a plan: the uncertainty that its shots will give, before anything has moved.

The covariance of a least-squares fit depends on derivatives and weights, not on what is measured.
So it can be computed from the plan alone, with the model that `identify` will fit:

1. Linearise the model at the planned poses, the tracker at its place in campaign.yaml.
2. Weigh each shot by the covariance that the tracker's data sheet states for its point.
3. Add the priors: each source of error is known to its tolerance before any shot (unknowns are in
   units of their tolerances), the tracker's frame not at all.
4. Invert: parameters' σ are the diagonal, σ of positions follow with the derivatives of positions
   all over the workspace, from which motions of the frame are removed.

An identification of a real robot may state other numbers: it finds the scatter of the robot itself
and the sizes of the groups of errors, which a forecast takes as the tolerances say.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import AXES, Array, Index
from campaigns.design.pose_sampling import sample_workspace
from campaigns.design.tours import positive_approach_shares
from campaigns.errors import ConfigInvalid, PlanInvalid
from campaigns.fit.error_model import ErrorModel, Observations, Prediction
from campaigns.fit.rigid_transforms import Transform
from campaigns.fit.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.fit.uncertainty import (
    free_turns_deg,
    length_std,
    marginal_information,
    null_directions_of,
    shot_information,
    without_frame,
)
from campaigns.kinematics.model import Kinematics
from campaigns.kinematics.platforms import ON_PLATE
from campaigns.kinematics.transmission import approach_along
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import joints_of, pairs_of, poses_of
from campaigns.shots.shot_sets import ShotSet

FRAME_PRECISION = 1e-8
"""Precision of the frame's unknowns, in mm and mrad, before any shot: practically none."""
FEWEST_SHOTS = 4
"""Number of shots that determine the tracker's frame, which three points do, with one to spare."""
LEAST_SHARE = 0.9
"""Smallest share of the sampled workspace at which the robot must be able to be assembled."""


@dataclass(frozen=True, slots=True, eq=False)
class Forecast:
    """Standard uncertainty that the shots of a plan will give."""

    shots: int
    """Number of identification shots."""
    std: dict[str, float]
    """1 σ of the robot's parameters that shots determine, by name, in the unit of robot files;
    without places on the plate."""
    units: dict[str, str]
    """Unit of each name: mm, deg or ppm."""
    position_std_mm: Array
    """1 σ of positions over the workspace, the frame best fitted, (N,)."""
    from_below: tuple[float, ...]
    """Share of the shots to which each joint comes from a smaller value, (n,)."""
    freedom: float
    """Degrees of freedom by which the fit will know the scatter of its shots."""
    rotation_std_deg: Array | None = None
    """1 σ of the tool's rotation over the workspace, (N,); None for a robot without turns."""

    def worst(self, unit: str) -> tuple[str, float] | None:
        """Return the parameter with the largest 1 σ in a unit, and this σ; None: no such unit."""
        rows = [(name, std) for name, std in self.std.items() if self.units[name] == unit]
        return max(rows, key=lambda row: row[1], default=None)


def forecast(
    shots: Sequence[PlannedShot],
    model: ErrorModel,
    tracker_mm: Array,
    instrument: TrackerUncertainty,
    judged: Array,
    turns: Array | None = None,
) -> Forecast:
    """Return the forecast of a plan seen from the tracker's place (3,) in the base frame.

    `judged` (N, 3, P) are derivatives of positions, as by `judged_positions`, `turns` those of the
    tool's turn, as by `judged_both`; None: of no interest.
    Raise `PlanInvalid` for fewer shots than determine the tracker's frame.
    """
    # The forecast is for whole pairs of the identification set; approach directions are taken
    # along all shots in order, since a drift shot between moves the joints as well.
    # Shots of a reflector elsewhere are observations of another kind (`campaigns.studies.outlook`).
    rows = points_of(shots)
    if len(rows) < FEWEST_SHOTS:
        raise PlanInvalid(
            f"{len(rows)} shots to identify from place no frame of the tracker",
            remedy=f"plan at least {FEWEST_SHOTS} shots, better 60",
        )
    joints, poses = joints_of(shots), poses_of(shots)
    identify = np.array([shot.purpose is ShotSet.IDENTIFICATION for shot in shots])
    approach = approach_along(joints)[rows]
    linearised = linearised_plan(model, joints[rows], poses[rows], approach, tracker_mm)
    noise = point_covariance_mm2(poses[rows, :3] - tracker_mm, instrument)
    weights = np.asarray(np.linalg.inv(noise), dtype=np.float64)
    information, size = shot_information(linearised.jacobian, weights), len(model.names)
    prior = prior_precision(model)
    covariance = np.asarray(np.linalg.inv(prior + information), dtype=np.float64)
    # Directions that shots leave at their prior are datum, not result: σ of parameters is stated
    # without them. They count in σ of positions, where they move any.
    null = null_directions_of(
        marginal_information(information, size), model.names, prior[:size, :size]
    )
    return Forecast(
        shots=len(rows),
        std=std_by_name(model, null.transform_covariance(covariance[:size, :size])),
        units=dict(zip(model.parameters, model.units, strict=False)),
        position_std_mm=length_std(judged, covariance[:size, :size]),
        from_below=tuple(positive_approach_shares(joints, joints[0], identify).tolist()),
        freedom=3.0 * len(rows) - len(prior) + float((covariance * prior).sum()),
        rotation_std_deg=None if turns is None else length_std(turns, covariance[:size, :size]),
    )


def points_of(shots: Sequence[PlannedShot]) -> Index:
    """Return the rows of the shots to identify from whose reflector is where robot.yaml says."""
    rows = pairs_of(shots, ShotSet.IDENTIFICATION).ravel()
    return rows[np.array([not shots[row].reflector for row in rows.tolist()], dtype=np.bool_)]


def linearised_plan(
    model: ErrorModel, joints: Array, poses: Array, approach: Array, tracker_mm: Array
) -> Prediction:
    """Return the model linearised at planned shots, the tracker upright in the base frame."""
    # Points as the nominal robot shows them, so residuals are zero. How the tracker's frame is
    # turned is not known before a run, nor does it matter: the fit has its turn as an unknown.
    observations = Observations.unmeasured(joints, poses, approach)
    observations = replace(observations, points=model.nominal.points(poses) - tracker_mm)
    frame = Transform(np.eye(3), -tracker_mm)
    return model.predict(np.zeros(len(model.names)), (frame,), observations, poses)


def prior_precision(model: ErrorModel) -> Array:
    """Return the precision of all unknowns and the frame before any shot, (Q, Q)."""
    # unknowns are in tolerances, so each has a prior of unit variance
    return np.diag([1.0] * len(model.names) + [FRAME_PRECISION] * 6)


def std_by_name(model: ErrorModel, covariance: Array) -> dict[str, float]:
    """Return 1 σ in file units of what shots determine, without places on the plate."""
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    rows = zip(model.parameters, model.groups, std, model.file_tolerance, strict=False)
    return {
        name: float(s * tolerance)
        for name, group, s, tolerance in rows
        if s > 1e-6 and group not in ON_PLATE
    }


def judged_positions(model: ErrorModel, robot: RobotModel, otherwise: Array) -> Array:
    """Return derivatives (N, 3, P) of positions all over the workspace, without frame motions.

    Every plan of a robot is judged at these positions. `otherwise` (M, t) are the poses for a robot
    whose workspace cannot be sampled. Raise `ConfigInvalid` for a robot that cannot be assembled at
    more than a tenth of the poses.
    """
    joints, poses = _judged_poses(robot, otherwise)
    return judged_at(model, robot.kinematics, joints, poses)


def judged_both(
    model: ErrorModel, robot: RobotModel, otherwise: Array
) -> tuple[Array, Array | None]:
    """Return what `judged_positions` does, and derivatives (N, 3, P) of the tool's turn there, deg.

    These are without turns of the base's and of the tool's axes; None for a robot without turns.
    """
    kinematics, (joints, poses) = robot.kinematics, _judged_poses(robot, otherwise)
    positions = judged_at(model, kinematics, joints, poses)
    if len(kinematics.mechanism.task) == len(AXES):
        return positions, None
    return positions, free_turns_deg(model, np.zeros(model.size), joints, poses)


def _judged_poses(robot: RobotModel, otherwise: Array) -> tuple[Array, Array]:
    """Return joints (N, n) and poses (N, t) at which every plan of a robot is judged."""
    poses = sample_workspace(robot.kinematics, robot.limits, robot.centre, robot.space)
    if poses is None:
        poses = otherwise
    joints = robot.kinematics.inverse(poses)
    if joints.is_solved.sum() < LEAST_SHARE * len(poses):
        raise ConfigInvalid(
            f"robot.yaml: the robot can be assembled at {joints.is_solved.sum()} of {len(poses)} "
            f"poses of its workspace (limit {100.0 * LEAST_SHARE:g} %)",
            remedy="correct its geometry and limits",
        )
    return joints.values[joints.is_solved], poses[joints.is_solved]


def judged_at(model: ErrorModel, kinematics: Kinematics, joints: Array, poses: Array) -> Array:
    """Return derivatives (N, 3, P) of positions at joints (N, n) and poses (N, t)."""
    observations = Observations.unmeasured(joints, poses)
    derivatives, _ = model.robot_columns(kinematics, observations, poses)
    return without_frame(derivatives, kinematics.points(poses))
