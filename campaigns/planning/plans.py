"""Plans by the paper's recipe: poses near the boundary, in pairs and order; drift shots between.

1. The region: the robot's limits, the tracker's view and `space` of campaign.yaml, each drawn in by
   a reserve, because the real robot differs from the nominal one that plans are made with.
2. Identification poses are drawn near the region's boundary, validation poses all over it, and
   each kind is paired at random: the estimator by distances (Corbel 2006, eq. 19) needs pairs.
3. All pairs are put into one tour with little travel, in which joints come evenly from both sides.
4. Drift shots, all at the workspace's centre, stand at even intervals in the tour.
5. Nests and known lengths, if campaign.yaml has any, are measured behind each drift shot.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
import scipy

from campaigns.arrays import Array, Index
from campaigns.design.pose_sampling import (
    FeasibleRegion,
    WorkspaceTooSmall,
    boundary_poses,
    interior_poses,
    random_pairs,
    sample_workspace,
)
from campaigns.design.restricted_space import (
    ANYWHERE,
    UNRESTRICTED,
    Disc,
    Rectangle,
    RestrictedSpace,
    Zone,
)
from campaigns.design.tours import balance_approaches
from campaigns.errors import PlanInvalid
from campaigns.files.wording import shown
from campaigns.planning.plan_file import PlannedShot
from campaigns.robots.reach import base_mm
from campaigns.robots.robot import RobotFile, pose_of, pose_row
from campaigns.settings.sections import KnownLengthConfig, NestConfig
from campaigns.settings.space import SpaceConfig, ZonesConfig
from campaigns.shots.shot_sets import ShotSet, pair_rows
from drivers.values import Pose, Vector3

JOINT_RESERVE_RAD = float(np.radians(0.5))
"""Distance of planned poses from joint limits: the real robot's errors must not exceed these."""
POSE_RESERVE_RAD = float(np.radians(1.0))
"""Distance of planned poses from limits of the platform's turn and of the forearms' swing."""
SPACE_RESERVE_MM = 2.0
"""Distance of planned poses from the walls of zones: the position that a robot computes there from
its joints may lie a little beyond."""
UNSEEN_JOINT_RESERVE_RAD = float(np.radians(5.0))
"""Distance of validation poses from joint limits: after a load the controller computes other joints
for a pose, which must still be within limits, or before and after cannot be compared."""

FEWEST_DRIFT_SHOTS = 3
PAIRS_BETWEEN = 10
"""Number of pairs between two drift shots, unless the number of drift shots is given."""

TRACKER_CLEARANCE_MM = 100.0
"""Distance from the robot below which a place of the tracker is refused."""
FARTHEST_M = 80.0
"""Largest distance at which a tracker measures, m. Places in mm that are inside the robot and below
this number were probably given in metres."""


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
    """Number of drift shots; None: one more for every ten pairs, at least three."""
    centre: Pose
    space: RestrictedSpace = UNRESTRICTED


def region_of(
    robot: RobotFile, view: View, centre: Pose, space: RestrictedSpace = UNRESTRICTED
) -> FeasibleRegion:
    """Return the region where poses may be planned: all limits of robot and space drawn in."""
    # The joint reserve is an angle of a crank; prismatic joints get what compares, in mm.
    limits = robot.limits.narrowed_by(
        joint=robot.mechanism.travel(JOINT_RESERVE_RAD),
        task=POSE_RESERVE_RAD,
        swing_rad=POSE_RESERVE_RAD,
    )
    facing = np.array(view.facing)
    return FeasibleRegion(
        robot.kinematics,
        limits,
        pose_row(centre),
        np.array(view.tracker_mm),
        facing / np.linalg.norm(facing),
        view.acceptance_rad,
        space.with_margin(SPACE_RESERVE_MM),
    )


def restricted_space(config: SpaceConfig, plate_radius_mm: float) -> RestrictedSpace:
    """Return the space that `space` in campaign.yaml leaves to a plate of this radius.

    A plate radius in `config` is used instead of the argument.
    """
    radius_mm = plate_radius_mm if config.plate_radius_mm is None else config.plate_radius_mm
    zones = (
        *_limits(config),
        *_zones(config.keep_in, "space.keep_in", keeps_in=True),
        *_zones(config.keep_out, "space.keep_out", keeps_in=False),
    )
    return RestrictedSpace(zones, radius_mm, config.margin_mm)


def _limits(config: SpaceConfig) -> Iterator[Zone]:
    """Yield the zones of `z_lowest_mm`, `z_highest_mm` and `radius_mm`, open on all other sides."""
    if config.z_lowest_mm is not None:
        name = f"space.z_lowest_mm {config.z_lowest_mm:g}"
        yield Zone(name, Rectangle(), (config.z_lowest_mm, math.inf), keeps_in=True)
    if config.z_highest_mm is not None:
        name = f"space.z_highest_mm {config.z_highest_mm:g}"
        yield Zone(name, Rectangle(), (-math.inf, config.z_highest_mm), keeps_in=True)
    if config.radius_mm is not None:
        name = f"space.radius_mm {config.radius_mm:g}"
        yield Zone(name, Disc((0.0, 0.0), config.radius_mm), ANYWHERE, keeps_in=True)


def _zones(zones: ZonesConfig, key: str, *, keeps_in: bool) -> Iterator[Zone]:
    """Yield the zones of boxes and cylinders, named by key, place in the list and user's name."""

    def full_name(place: str, user_name: str) -> str:
        return f"{key}.{place} '{shown(user_name)}'" if user_name else f"{key}.{place}"

    for place, box in enumerate(zones.boxes):
        area = Rectangle(box.x_mm or ANYWHERE, box.y_mm or ANYWHERE)
        name = full_name(f"boxes[{place}]", box.name)
        yield Zone(name, area, box.z_mm or ANYWHERE, keeps_in)
    for place, cylinder in enumerate(zones.cylinders):
        disc = Disc(cylinder.centre_mm, cylinder.radius_mm)
        name = full_name(f"cylinders[{place}]", cylinder.name)
        yield Zone(name, disc, cylinder.z_mm or ANYWHERE, keeps_in)


def make_plan(
    robot: RobotFile, view: View, request: PlanRequest, rng: np.random.Generator
) -> tuple[PlannedShot, ...]:
    """Choose identification pairs near the boundary, validation pairs all over, drift shots.

    Both kinds of pairs share one tour with little travel, so that slow effects meet them alike.
    Raise `PlanInvalid` if the workspace holds too few poses that can be taken and seen.
    """
    region = region_of(robot, view, request.centre, request.space)
    # Both checks come first: a wrong centre or tracker would show below as too small a workspace.
    _check_centre(region)
    _check_tracker(region)
    further_rad = UNSEEN_JOINT_RESERVE_RAD - JOINT_RESERVE_RAD  # the region has its reserve already
    limits = region.limits.narrowed_by(joint=robot.mechanism.travel(further_rad))
    inner = replace(region, limits=limits)
    try:
        fitted = boundary_poses(region, request.identification_shots, rng)
        unseen = interior_poses(inner, 2 * request.validation_pairs, rng)
    except WorkspaceTooSmall as error:
        raise too_small(error, region, "shots") from error
    poses = np.vstack([fitted, unseen])
    pairs = np.vstack([random_pairs(fitted, rng), len(fitted) + random_pairs(unseen, rng)])
    return ordered_shots(region, poses, pairs, len(fitted), request.drift_shots)


# A centre may fail for three reasons, asked in the order in which a user can mend them: the robot
# cannot take the pose, the tracker cannot see it (most often because the tracker's place is wrong,
# which has an error of its own), or `space` forbids it.
def _check_centre(region: FeasibleRegion) -> None:
    """Raise `PlanInvalid`, with the reason, if no shot can be taken at the workspace's centre."""
    centre = region.centre[None]
    if region.allows(centre)[0]:
        return
    at = f"the workspace's centre {_in_words(region.centre[:3])}"
    judged = region.kinematics.feasibility(region.limits, centre)
    if not judged.feasible[0]:
        reasons = judged.describe(0)
        raise PlanInvalid(
            f"{at} cannot be taken: {'; '.join(reasons)}",
            remedy="correct validation.centre_mm, or limits in robot.yaml, from which plans keep "
            "a reserve",
        )
    if not region.can_measure(centre)[0]:
        _check_tracker(region)
        away_rad = region.incidence_rad(centre)
        raise PlanInvalid(
            f"{at} cannot be seen: the reflector looks {np.degrees(away_rad[0]):.0f}° away from "
            f"the tracker, limit {np.degrees(region.acceptance_rad):g}°",
            remedy="correct tracker.place_mm or tracker.reflector_facing, which may be left empty",
        )
    why = region.space.fault(region.centre[:3]) or "no other pose can be reached from it"
    raise PlanInvalid(
        f"{at} is where the robot may not go: {why}",
        remedy="move validation.centre_mm, or correct `space` in campaign.yaml",
    )


# The robot fills about the convex hull of its base and its workspace. Rows of SciPy's `equations`
# are a facet's outward normal n and offset d: n·x + d is the signed distance of x from the facet's
# plane. Outside of a convex body at least one is positive, and the largest is at most the distance
# from the body: a tracker that passes is at least the clearance away.
def _check_tracker(region: FeasibleRegion) -> None:
    """Raise `PlanInvalid` for a tracker in the robot, also where its place was given in metres."""
    place = region.view_from_mm
    sample = sample_workspace(region.kinematics, region.limits, region.centre)
    if sample is None:
        return  # hardly any pose can be taken: the draw of poses says so
    robot_mm = np.vstack([sample[:, :3], base_mm(region.kinematics)])
    # what a robot in a plane fills is flat, which QJ thickens by rounding errors
    options = "QJ" if region.kinematics.mechanism.is_planar else None
    hull = scipy.spatial.ConvexHull(robot_mm, qhull_options=options).equations
    if (hull[:, :3] @ place + hull[:, -1]).max() > TRACKER_CLEARANCE_MM:
        return
    hint = ", as if it were given in metres" if 0.0 < np.linalg.norm(place) < FARTHEST_M else ""
    raise PlanInvalid(
        f"the tracker's place {_in_words(place)} is in the robot, between its base and where its "
        f"plate goes (limit {TRACKER_CLEARANCE_MM:g} mm away){hint}",
        remedy="correct tracker.place_mm: [x, y, z] in mm, seen from the robot's base",
    )


def _in_words(place_mm: Array) -> str:
    """Write a place (3,) for an error text."""
    x, y, z = (f"{value:g}" for value in place_mm)
    return f"({x}, {y}, {z}) mm"


def too_small(error: WorkspaceTooSmall, region: FeasibleRegion, fewer: str) -> PlanInvalid:
    """Return the error for the operator if `region` has too little room for shots.

    `fewer` names what may be reduced: shots or candidates.
    """
    remedy = f"check the robot's limits and the tracker's place, or ask for fewer {fewer}"
    if region.space.is_restricted:
        zones = ", ".join(zone.name for zone in region.space.zones)
        remedy = f"widen `space` in campaign.yaml ({zones}), or {remedy}"
    return PlanInvalid(f"too small a part of the workspace can be measured: {error}", remedy=remedy)


def ordered_shots(
    region: FeasibleRegion, poses: Array, pairs: Index, fitted: int, drift_shots: int | None
) -> tuple[PlannedShot, ...]:
    """Put pairs (M, 2) of poses (N, t) into one tour, drift shots at even intervals in it.

    The first `fitted` poses are to identify from: their joints come evenly from both sides, which
    determines backlash. Without a number of drift shots there is one for every ten pairs.
    """
    # 1. The tour, from the centre. Angles and lengths of joints are compared as turns of a crank.
    kinematics = region.kinematics
    joints = kinematics.inverse(poses).values_or_raise()
    centre_joints = kinematics.inverse(region.centre[None]).values_or_raise()[0]
    turns, start = kinematics.comparable(joints), kinematics.comparable(centre_joints)
    tour = balance_approaches(turns, pairs, start, np.arange(len(poses)) < fitted)
    # 2. Places of drift shots in the tour: one before its first pair, one behind its last.
    if drift_shots is None:
        drift_shots = max(FEWEST_DRIFT_SHOTS, 1 + len(tour) // PAIRS_BETWEEN)
    drift_before = np.round(np.linspace(0, len(tour), drift_shots)).astype(int).tolist()
    # 3. All shots in order; a pair's number is its place in the tour.
    centre = pose_of(region.centre)
    drift = PlannedShot(0, ShotSet.DRIFT, None, centre, tuple(centre_joints.tolist()))
    shots: list[PlannedShot] = []
    for place, pair in enumerate(tour):
        shots += [drift] * drift_before.count(place)
        purpose = ShotSet.IDENTIFICATION if pair[0] < fitted else ShotSet.VALIDATION
        shots += [
            PlannedShot(0, purpose, place, pose_of(poses[end]), tuple(joints[end].tolist()))
            for end in pair
        ]
    shots += [drift] * drift_before.count(len(tour))
    return tuple(replace(shot, shot=number) for number, shot in enumerate(shots))


# All pairs at one place of the reflector first, then all at the next: the fewest moves. Every
# second pair of the tour is of each, so that each goes all over the workspace.
def in_turn(shots: Sequence[PlannedShot], reflectors: Sequence[str]) -> tuple[PlannedShot, ...]:
    """Deal the pairs of a plan to places of the reflector in turn, each with its drift shots.

    `reflectors` are names of objects; "" is where robot.yaml says. Shots are renumbered.
    """
    drift = [shot for shot in shots if shot.purpose is ShotSet.DRIFT]
    by_pair: dict[int | None, list[PlannedShot]] = {}
    for shot in shots:
        if shot.pair is not None:
            by_pair.setdefault(shot.pair, []).append(shot)
    ordered: list[PlannedShot] = []
    count = max(FEWEST_DRIFT_SHOTS, math.ceil(len(drift) / len(reflectors)))
    for place, name in enumerate(reflectors):
        # each set is dealt by itself, so that each place has its share of both
        mine = [
            pair
            for purpose in (ShotSet.IDENTIFICATION, ShotSet.VALIDATION)
            for pair in [p for p in by_pair.values() if p[0].purpose is purpose][
                place :: len(reflectors)
            ]
        ]
        mine.sort(key=lambda pair: shots.index(pair[0]))
        before = np.round(np.linspace(0, len(mine), count)).astype(int).tolist()
        for number, pair in enumerate([*mine, []]):
            of_place = [*drift[:1] * before.count(number), *pair]
            ordered += [replace(shot, reflector=name) for shot in of_place]
    return tuple(replace(shot, shot=number) for number, shot in enumerate(ordered))


def with_nests(
    shots: Sequence[PlannedShot], nests: Sequence[NestConfig], lengths: Sequence[KnownLengthConfig]
) -> tuple[PlannedShot, ...]:
    """Add shots of all nests behind each drift shot, the robot standing there, and renumber.

    Nests at the ends of known lengths become pairs of known lengths, others shots of their own.
    """
    # A drift shot is where the robot stands still anyway: fixed reflectors are measured from its
    # pose without any motion, and show at the times of drift shots whether the tracker has moved.
    bars = [bar.nests for bar in lengths if bar.nests]
    single_nests = [nest.name for nest in nests if not any(nest.name in bar for bar in bars)]
    pair = max((shot.pair for shot in shots if shot.pair is not None), default=-1)
    all_shots: list[PlannedShot] = []
    for shot in shots:
        all_shots.append(shot)
        if shot.purpose is not ShotSet.DRIFT:
            continue
        for bar in bars:
            pair += 1  # each measurement of a bar is a pair of its own
            length = replace(shot, purpose=ShotSet.KNOWN_LENGTH, pair=pair, reflector="")
            all_shots += [replace(length, nest=name) for name in bar]
        nest = replace(shot, purpose=ShotSet.NEST, reflector="")
        all_shots += [replace(nest, nest=name) for name in single_nests]
    return tuple(replace(shot, shot=number) for number, shot in enumerate(all_shots))


def joints_of(shots: Sequence[PlannedShot]) -> Array:
    """Return the joints (N, n) of planned shots."""
    return np.array([shot.joints for shot in shots])


def poses_of(shots: Sequence[PlannedShot]) -> Array:
    """Return the poses (N, t) of planned shots."""
    return np.array([pose_row(shot.pose) for shot in shots])


def pairs_of(shots: Sequence[PlannedShot], purpose: ShotSet) -> Index:
    """Return the rows of shots that stand in whole pairs of a set, (M, 2)."""
    pairs = (shot.pair if shot.purpose is purpose else None for shot in shots)
    return pair_rows(tuple(pairs)).rows
