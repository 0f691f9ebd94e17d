"""Forecast of a plan: the uncertainty that its shots will give, before anything has moved.

It is the posterior of the same model that `identify` fits, with all groups at their tolerances and
shots that scatter as the tracker states.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array
from campaigns.design.pose_sampling import sample_workspace
from campaigns.design.tours import positive_approach_shares
from campaigns.errors import ConfigInvalid, PlanInvalid
from campaigns.fit.error_model import ErrorModel, Linearised, Observations
from campaigns.fit.rigid_transforms import Transform
from campaigns.fit.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.fit.uncertainty import (
    marginal_information,
    null_directions_of,
    position_std_mm,
    shot_information,
    without_frame,
)
from campaigns.kinematics.mechanism import Kinematics
from campaigns.kinematics.transmission import approach_along
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import joints_of, pairs_of, poses_of
from campaigns.shots.shot_sets import ShotSet

FRAME_PRECISION = 1e-8
"""Precision of the frame's unknowns, in mm and mrad, before any shot: practically none."""
FEWEST_SHOTS = 4
"""Shots that place the tracker's frame, with one to spare."""
LEAST_SHARE = 0.9
"""Share of the workspace that the robot must be able to take."""


@dataclass(frozen=True, slots=True, eq=False)
class Forecast:
    """Standard uncertainty that the shots of a plan will give."""

    shots: int
    """Shots to identify from."""
    std: dict[str, float]
    """1 σ of the robot's parameters that shots determine, by name in its file unit."""
    units: dict[str, str]
    """Unit of each name: mm, deg or ppm."""
    position_std_mm: Array
    """1 σ of positions over the workspace, the frame best fitted, (N,)."""
    from_below: tuple[float, ...]
    """Share of the shots to which each joint comes from a smaller value, (n,)."""

    def worst(self, unit: str) -> tuple[str, float] | None:
        """Return the parameter in a unit that will be known worst, with its 1 σ."""
        rows = [(name, std) for name, std in self.std.items() if self.units[name] == unit]
        return max(rows, key=lambda row: row[1], default=None)


def forecast(
    shots: Sequence[PlannedShot],
    model: ErrorModel,
    tracker_mm: Array,
    instrument: TrackerUncertainty,
    judged: Array,
) -> Forecast:
    """Return the forecast of a plan seen from the tracker's place (3,) in the base frame.

    `judged` (N, 3, P) are derivatives of positions, as by `judged_positions`.
    Raise `PlanInvalid` for fewer shots than place the tracker's frame.
    """
    rows = pairs_of(shots, ShotSet.IDENTIFICATION).ravel()
    if len(rows) < FEWEST_SHOTS:
        raise PlanInvalid(
            f"{len(rows)} shots to identify from place no frame of the tracker",
            remedy=f"plan at least {FEWEST_SHOTS} shots, better 60",
        )
    joints, poses = joints_of(shots), poses_of(shots)
    identify = np.array([shot.purpose is ShotSet.IDENTIFICATION for shot in shots])
    approach = approach_along(joints)[rows]
    at = linearised_plan(model, joints[rows], poses[rows], approach, tracker_mm)
    noise = point_covariance_mm2(poses[rows, :3] - tracker_mm, instrument)
    weights = np.asarray(np.linalg.inv(noise), dtype=np.float64)
    information, size = shot_information(at.jacobian, weights), len(model.names)
    covariance = np.asarray(np.linalg.inv(prior_precision(model) + information), dtype=np.float64)
    null = null_directions_of(marginal_information(information, size), model.names)
    return Forecast(
        shots=len(rows),
        std=_std_by_name(model, null.transform_covariance(covariance[:size, :size])),
        units=dict(zip(model.parameters, model.units, strict=False)),
        position_std_mm=position_std_mm(judged, covariance[:size, :size]),
        from_below=tuple(positive_approach_shares(joints, joints[0], identify).tolist()),
    )


def linearised_plan(
    model: ErrorModel, joints: Array, poses: Array, approach: Array, tracker_mm: Array
) -> Linearised:
    """Return the model linearised at planned shots, the tracker upright in the base frame."""
    observations = Observations.unmeasured(joints, poses, approach)
    observations = replace(observations, points=poses[:, :3] - tracker_mm)
    frame = Transform(np.eye(3), -tracker_mm)
    return model.linearise(observations, np.zeros(len(model.names)), (frame,), poses)


def prior_precision(model: ErrorModel) -> Array:
    """Return the precision of all unknowns and the frame before any shot, (Q, Q)."""
    return np.diag([1.0] * len(model.names) + [FRAME_PRECISION] * 6)


def _std_by_name(model: ErrorModel, covariance: Array) -> dict[str, float]:
    """Return 1 σ in file units of the parameters that shots determine."""
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    rows = zip(model.parameters, std, model.file_tolerance, strict=False)
    return {name: float(s * tolerance) for name, s, tolerance in rows if s > 1e-6}


def judged_positions(model: ErrorModel, robot: RobotModel, otherwise: Array) -> Array:
    """Return derivatives of positions all over the workspace, the same ones for every plan.

    They are (N, 3, P), without the frame's motion. `otherwise` (M, t) are poses for a robot that
    can take hardly any others. Raise `ConfigInvalid` for a robot that cannot be assembled there.
    """
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
    return judged_at(
        model, robot.kinematics, joints.values[joints.is_solved], poses[joints.is_solved]
    )


def judged_at(model: ErrorModel, kinematics: Kinematics, joints: Array, poses: Array) -> Array:
    """Return derivatives (N, 3, P) of positions at joints (N, n) and poses (N, t)."""
    by, _ = model.robot_columns(kinematics, Observations.unmeasured(joints, poses), poses)
    return without_frame(by, poses[:, :3])
