"""Plans a campaign: which poses, in which pairs and order; judges a plan before anything moves."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.design.pose_sampling import (
    FeasibleRegion,
    WorkspaceTooSmall,
    boundary_poses,
    interior_poses,
    random_pairs,
)
from campaigns.design.tours import shortest_tour
from campaigns.errors import PlanInvalid
from campaigns.mechanisms.feasibility import Limits
from campaigns.mechanisms.geometry import Geometry
from campaigns.mechanisms.par4 import inverse
from campaigns.planning.plan_file import PlannedShot
from campaigns.robots.robot import RobotFile, numeric_geometry, numeric_limits, pose_of, pose_row
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Pose, Vector3

JOINT_RESERVE_RAD = float(np.radians(0.5))
"""Planned poses keep off the limits by this, so that the real robot's errors don't break them."""
POSE_RESERVE_RAD = float(np.radians(1.0))
UNSEEN_JOINT_RESERVE_RAD = float(np.radians(5.0))
"""Validation poses keep further off: with other parameters in the controller the same pose takes
other encoder angles, and it should still be there to be compared."""


@dataclass(frozen=True, slots=True)
class View:
    """How the tracker sees the reflector; places in the base frame."""

    tracker_mm: Vector3
    facing: Vector3
    """Direction of the reflector's axis; need not be of unit length."""
    acceptance_rad: float


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """What a plan shall hold."""

    identification_shots: int
    validation_pairs: int
    drift_shots: int
    centre: Pose


def with_reserve(limits: Limits) -> Limits:
    """Limits drawn in, for planning."""
    low, high = limits.joint_rad
    left, right = limits.theta_rad
    return replace(
        limits,
        joint_rad=(low + JOINT_RESERVE_RAD, high - JOINT_RESERVE_RAD),
        theta_rad=(left + POSE_RESERVE_RAD, right - POSE_RESERVE_RAD),
        forearm_swing_rad=limits.forearm_swing_rad - POSE_RESERVE_RAD,
    )


def region_of(geometry: Geometry, limits: Limits, view: View, centre: Pose) -> FeasibleRegion:
    """Where poses may be placed."""
    facing = np.array(view.facing)
    return FeasibleRegion(
        geometry,
        limits,
        pose_row(centre),
        np.array(view.tracker_mm),
        facing / np.linalg.norm(facing),
        view.acceptance_rad,
    )


def make_plan(
    robot: RobotFile, view: View, request: PlanRequest, rng: np.random.Generator
) -> tuple[PlannedShot, ...]:
    """Identification pairs near the boundary, validation pairs all over the workspace, drift shots.

    Both kinds of pairs share one tour with little travel, so that slow effects meet them alike.
    Raises `PlanInvalid` when the workspace holds too few poses that can be taken and seen.
    """
    geometry = numeric_geometry(robot)
    region = region_of(geometry, with_reserve(numeric_limits(robot)), view, request.centre)
    if not region.allows(region.centre[None])[0]:
        x, y, z = (f"{value:g}" for value in region.centre[:3])
        raise PlanInvalid(
            f"the workspace's centre ({x}, {y}, {z}) mm cannot be taken, or not be seen",
            remedy="correct validation.centre_mm, tracker.place_mm or tracker.reflector_facing",
        )
    try:
        fitted = boundary_poses(region, request.identification_shots, rng)
        unseen = interior_poses(_inner(region), 2 * request.validation_pairs, rng)
    except WorkspaceTooSmall as error:
        raise PlanInvalid(
            f"too small a part of the workspace can be measured: {error}",
            remedy="check the robot's limits and the tracker's place, or ask for fewer shots",
        ) from error
    poses = np.vstack([fitted, unseen])
    joints = inverse(geometry, poses).require()
    centre_joints = inverse(geometry, region.centre[None]).require()[0]
    pairs = np.vstack([random_pairs(fitted, rng), random_pairs(unseen, rng) + len(fitted)])
    tour = shortest_tour(joints, pairs, centre_joints)
    drift = (region.centre, centre_joints)
    return numbered_shots(tour, poses, joints, len(fitted), drift, request.drift_shots)


def _inner(region: FeasibleRegion) -> FeasibleRegion:
    """Where validation poses may be placed."""
    low, high = region.limits.joint_rad
    further = UNSEEN_JOINT_RESERVE_RAD - JOINT_RESERVE_RAD
    limits = replace(region.limits, joint_rad=(low + further, high - further))
    return replace(region, limits=limits)


def numbered_shots(
    tour: Index,
    poses: Array,
    joints: Array,
    fitted: int,
    drift: tuple[Array, Array],
    drift_shots: int,
) -> tuple[PlannedShot, ...]:
    """The tour as shots, drift shots at even intervals from the first to the last."""
    rows: list[tuple[ShotSet, int | None, Array, Array]] = []
    drift_before = np.round(np.linspace(0, len(tour), drift_shots)).astype(int).tolist()
    for place, pair in enumerate(tour):
        rows += [(ShotSet.DRIFT, None, *drift)] * drift_before.count(place)
        purpose = ShotSet.IDENTIFICATION if pair[0] < fitted else ShotSet.VALIDATION
        rows += [(purpose, place, poses[end], joints[end]) for end in pair]
    rows += [(ShotSet.DRIFT, None, *drift)] * drift_before.count(len(tour))
    return tuple(
        PlannedShot(number, purpose, pair, pose_of(pose), tuple(joint.tolist()))
        for number, (purpose, pair, pose, joint) in enumerate(rows)
    )


def joints_of(shots: Sequence[PlannedShot]) -> Array:
    """(N, 4) in rad."""
    return np.array([shot.joints_rad for shot in shots])


def poses_of(shots: Sequence[PlannedShot]) -> Array:
    """(N, 4) in mm and rad."""
    return np.array([pose_row(shot.pose) for shot in shots])


def pairs_of(shots: Sequence[PlannedShot], purpose: ShotSet) -> Index:
    """Rows of the shots that stand in whole pairs for that purpose, (M, 2)."""
    rows: dict[int, list[int]] = {}
    for row, shot in enumerate(shots):
        if shot.purpose is purpose and shot.pair is not None:
            rows.setdefault(shot.pair, []).append(row)
    whole = [both for both in rows.values() if len(both) == 2]
    return np.array(whole, dtype=np.intp).reshape(-1, 2)
