"""Plans by the paper's recipe: poses near the boundary, in pairs and order; drift shots between."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
import scipy

from campaigns.arrays import Array, Index
from campaigns.design.pose_sampling import (
    FeasibleRegion,
    WorkspaceTooSmall,
    boundary_poses,
    incidence_rad,
    interior_poses,
    random_pairs,
    sample_workspace,
)
from campaigns.design.restricted_space import UNRESTRICTED, RestrictedSpace
from campaigns.design.tours import DRIFT_MARGIN, EVEN_SHARE, balance_approaches, shortest_tour
from campaigns.errors import PlanInvalid
from campaigns.kinematics.feasibility import Limits
from campaigns.kinematics.mechanism import Kinematics
from campaigns.planning.plan_file import PlannedShot
from campaigns.robots.reach import base_mm
from campaigns.robots.robot import RobotFile, pose_of, pose_row
from campaigns.settings.sections import KnownLengthConfig, NestConfig
from campaigns.shots.shot_sets import ShotSet, pair_rows
from drivers.values import Pose, Vector3

JOINT_RESERVE_RAD = float(np.radians(0.5))
"""Planned poses keep off the limits by this, so that the real robot's errors don't break them."""
POSE_RESERVE_RAD = float(np.radians(1.0))
SPACE_RESERVE_MM = 2.0
"""Planned poses keep off the walls of zones by this: a robot that stands there may read itself a
little beyond."""
UNSEEN_JOINT_RESERVE_RAD = float(np.radians(5.0))
"""Validation poses keep further off: with other parameters in the controller the same pose takes
other encoder angles, and it should still be there to be compared."""

FEWEST_DRIFT_SHOTS = 3
EVENLY = (EVEN_SHARE[0] + DRIFT_MARGIN, EVEN_SHARE[1] - DRIFT_MARGIN)
PAIRS_BETWEEN = 10
"""Two drift shots, where nobody says how many there shall be."""

TRACKER_CLEARANCE_MM = 100.0
"""Distance of a tracker's place from the robot, below which it cannot stand there."""
FARTHEST_M = 80.0
"""Largest distance of a tracker: numbers below it are metres where they cannot be millimetres."""


class Placement(StrEnum):
    """Placement of poses; the value is the word on the command line and in campaign.yaml."""

    BOUNDARY = "boundary"
    OPTIMAL = "optimal"


@dataclass(frozen=True, slots=True)
class View:
    """View of the reflector from the tracker; places in the base frame."""

    tracker_mm: Vector3
    facing: Vector3
    """Direction of the reflector's axis; need not be of unit length."""
    acceptance_rad: float


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """Request for a plan: numbers of shots of each kind, the workspace's centre and its space."""

    identification_shots: int
    validation_pairs: int
    drift_shots: int | None
    """None: as many as show how the robot warms up."""
    centre: Pose
    space: RestrictedSpace = UNRESTRICTED


def with_reserve(robot: RobotFile) -> Limits:
    """Limits of a robot drawn in, for planning."""
    return robot.limits.drawn_in(
        joint=JOINT_RESERVE_RAD * robot.mechanism.joints[0].scale,
        task=POSE_RESERVE_RAD,
        swing_rad=POSE_RESERVE_RAD,
    )


def region_of(
    kinematics: Kinematics,
    limits: Limits,
    view: View,
    centre: Pose,
    space: RestrictedSpace = UNRESTRICTED,
) -> FeasibleRegion:
    """Region where poses may be placed."""
    facing = np.array(view.facing)
    return FeasibleRegion(
        kinematics,
        limits,
        pose_row(centre),
        np.array(view.tracker_mm),
        facing / np.linalg.norm(facing),
        view.acceptance_rad,
        space.with_margin(SPACE_RESERVE_MM),
    )


def requested_region(robot: RobotFile, view: View, request: PlanRequest) -> FeasibleRegion:
    """Region where the poses of a plan may be placed."""
    limits = with_reserve(robot)
    return region_of(robot.kinematics, limits, view, request.centre, request.space)


def make_plan(
    robot: RobotFile, view: View, request: PlanRequest, rng: np.random.Generator
) -> tuple[PlannedShot, ...]:
    """Identification pairs near the boundary, validation pairs all over the workspace, drift shots.

    Both kinds of pairs share one tour with little travel, so that slow effects meet them alike.
    Raises `PlanInvalid` when the workspace holds too few poses that can be taken and seen.
    """
    kinematics = robot.kinematics
    region = requested_region(robot, view, request)
    _check_centre(region)
    _check_tracker(region)
    try:
        fitted = boundary_poses(region, request.identification_shots, rng)
        unseen = interior_poses(_inner(region), 2 * request.validation_pairs, rng)
    except WorkspaceTooSmall as error:
        raise too_small(error, region, "shots") from error
    poses = np.vstack([fitted, unseen])
    joints = kinematics.inverse(poses).values_or_raise()
    centre_joints = kinematics.inverse(region.centre[None]).values_or_raise()[0]
    pairs = np.vstack([random_pairs(fitted, rng), random_pairs(unseen, rng) + len(fitted)])
    turns, start = (kinematics.comparable(each) for each in (joints, centre_joints))
    tour = tour_of(pairs, turns, start, len(fitted))
    drift = (region.centre, centre_joints)
    return numbered_shots(tour, poses, joints, len(fitted), drift, request.drift_shots)


def _check_centre(region: FeasibleRegion) -> None:
    """Raise `PlanInvalid` for a centre of the workspace that is no place for a shot."""
    centre = region.centre[None]
    if region.allows(centre)[0]:
        return
    at = f"the workspace's centre {_in_words(region.centre[:3])}"
    if not region.kinematics.feasibility(region.limits, centre).feasible[0]:
        reasons = region.kinematics.feasibility(region.limits, centre).describe(0)
        raise PlanInvalid(
            f"{at} cannot be taken: {'; '.join(reasons)}", remedy="correct validation.centre_mm"
        )
    if not region.can_measure(centre)[0]:
        _check_tracker(region)
        away_rad = incidence_rad(centre[:, :3], region.view_from_mm, region.reflector_facing)
        raise PlanInvalid(
            f"{at} cannot be seen: the reflector looks {np.degrees(away_rad[0]):.0f}° away from "
            f"the tracker, limit {np.degrees(region.acceptance_rad):g}°",
            remedy="correct tracker.place_mm or tracker.reflector_facing, which may be left empty",
        )
    why = region.space.fault(region.centre[:3]) or "no other pose can be come to from it"
    raise PlanInvalid(
        f"{at} is where the robot may not go: {why}",
        remedy="move validation.centre_mm, or correct `space` in campaign.yaml",
    )


def _check_tracker(region: FeasibleRegion) -> None:
    """Raise `PlanInvalid` for a tracker in the robot, also where its place was given in metres."""
    place = region.view_from_mm
    sample = sample_workspace(region.kinematics, region.limits, region.centre)
    if sample is None:
        return
    robot_mm = np.vstack([sample[:, :3], base_mm(region.kinematics)])
    hull = scipy.spatial.ConvexHull(robot_mm).equations
    if (hull[:, :3] @ place + hull[:, -1]).max() > TRACKER_CLEARANCE_MM:
        return
    hint = ", as if it were given in metres" if 0.0 < np.linalg.norm(place) < FARTHEST_M else ""
    raise PlanInvalid(
        f"the tracker's place {_in_words(place)} is in the robot, between its base and where its "
        f"plate goes (limit {TRACKER_CLEARANCE_MM:g} mm away){hint}",
        remedy="correct tracker.place_mm: [x, y, z] in mm, seen from the robot's base",
    )


def _in_words(place_mm: Array) -> str:
    x, y, z = (f"{value:g}" for value in place_mm)
    return f"({x}, {y}, {z}) mm"


def too_small(error: WorkspaceTooSmall, region: FeasibleRegion, fewer: str) -> PlanInvalid:
    """Error for the operator: hardly any place is left for shots, and why."""
    remedy = f"check the robot's limits and the tracker's place, or ask for fewer {fewer}"
    if region.space.is_restricted:
        zones = ", ".join(zone.name for zone in region.space.zones)
        remedy = f"widen `space` in campaign.yaml ({zones}), or {remedy}"
    return PlanInvalid(f"too small a part of the workspace can be measured: {error}", remedy=remedy)


def _inner(region: FeasibleRegion) -> FeasibleRegion:
    """Region where validation poses may be placed."""
    further = UNSEEN_JOINT_RESERVE_RAD - JOINT_RESERVE_RAD
    scale = region.kinematics.mechanism.joints[0].scale
    return replace(region, limits=region.limits.drawn_in(joint=further * scale))


def tour_of(pairs: Index, joints: Array, start: Array, fitted: int) -> Index:
    """Return a tour of the pairs (M, 2), of which the first rows are fitted.

    Their joints (N, n) come evenly from both sides, which determines backlash.
    """
    if not fitted:
        return shortest_tour(joints, pairs, start)
    counted = np.arange(len(joints)) < fitted
    return balance_approaches(joints, pairs, start, counted, EVENLY)


def numbered_shots(
    tour: Index,
    poses: Array,
    joints: Array,
    fitted: int,
    drift: tuple[Array, Array],
    drift_shots: int | None,
) -> tuple[PlannedShot, ...]:
    """The tour as shots, drift shots at even intervals from the first to the last."""
    if drift_shots is None:
        drift_shots = max(FEWEST_DRIFT_SHOTS, 1 + len(tour) // PAIRS_BETWEEN)
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


def with_nests(
    shots: Sequence[PlannedShot], nests: Sequence[NestConfig], known: Sequence[KnownLengthConfig]
) -> tuple[PlannedShot, ...]:
    """Shots numbered anew, behind each drift shot those of all nests, the robot standing there.

    Nests at the ends of known lengths are measured as these, the others for themselves.
    """
    bars = [bar.nests for bar in known if bar.nests]
    alone = [nest.name for nest in nests if not any(nest.name in bar for bar in bars)]
    pair = max((shot.pair for shot in shots if shot.pair is not None), default=-1)
    found: list[PlannedShot] = []
    for shot in shots:
        found.append(shot)
        if shot.purpose is not ShotSet.DRIFT:
            continue
        for bar in bars:
            pair += 1
            length = replace(shot, purpose=ShotSet.KNOWN_LENGTH, pair=pair)
            found += [replace(length, nest=name) for name in bar]
        found += [replace(shot, purpose=ShotSet.NEST, nest=name) for name in alone]
    return tuple(replace(shot, shot=number) for number, shot in enumerate(found))


def joints_of(shots: Sequence[PlannedShot]) -> Array:
    """Joints (N, n) of planned shots."""
    return np.array([shot.joints for shot in shots])


def poses_of(shots: Sequence[PlannedShot]) -> Array:
    """Poses (N, t) of planned shots."""
    return np.array([pose_row(shot.pose) for shot in shots])


def pairs_of(shots: Sequence[PlannedShot], purpose: ShotSet) -> Index:
    """Rows of the shots that stand in whole pairs of a set, (M, 2)."""
    pairs = (shot.pair if shot.purpose is purpose else None for shot in shots)
    return pair_rows(tuple(pairs)).rows
