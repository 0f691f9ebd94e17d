"""Plans by the paper's recipe: poses near the boundary, in pairs and order; drift shots between."""

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
    incidence_rad,
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
"""Planned poses keep off the limits by this, so that the real robot's errors don't break them."""
POSE_RESERVE_RAD = float(np.radians(1.0))
SPACE_RESERVE_MM = 2.0
"""Planned poses keep off the walls of zones by this: a robot that stands there may read itself a
little beyond."""
UNSEEN_JOINT_RESERVE_RAD = float(np.radians(5.0))
"""Validation poses keep further off: with other parameters in the controller the same pose takes
other encoder angles, and must still be possible to be compared."""

FEWEST_DRIFT_SHOTS = 3
PAIRS_BETWEEN = 10
"""Pairs between two drift shots, unless their number is given."""

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


def region_of(
    robot: RobotFile, view: View, centre: Pose, space: RestrictedSpace = UNRESTRICTED
) -> FeasibleRegion:
    """Return the region where poses may be planned: all limits of robot and space drawn in."""
    limits = robot.limits.narrowed_by(
        joint=JOINT_RESERVE_RAD * robot.mechanism.joints[0].scale,
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
    """Return the space that `space` in campaign.yaml leaves; its plate radius goes before."""
    radius_mm = plate_radius_mm if config.plate_radius_mm is None else config.plate_radius_mm
    zones = (
        *_limits(config),
        *_zones(config.keep_in, "space.keep_in", keeps_in=True),
        *_zones(config.keep_out, "space.keep_out", keeps_in=False),
    )
    return RestrictedSpace(zones, radius_mm, config.margin_mm)


def _limits(config: SpaceConfig) -> Iterator[Zone]:
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
    def name(place: str, given: str) -> str:
        return f"{key}.{place} '{shown(given)}'" if given else f"{key}.{place}"

    for place, box in enumerate(zones.boxes):
        area = Rectangle(box.x_mm or ANYWHERE, box.y_mm or ANYWHERE)
        yield Zone(name(f"boxes[{place}]", box.name), area, box.z_mm or ANYWHERE, keeps_in)
    for place, round_zone in enumerate(zones.cylinders):
        disc, z_mm = Disc(round_zone.centre_mm, round_zone.radius_mm), round_zone.z_mm or ANYWHERE
        yield Zone(name(f"cylinders[{place}]", round_zone.name), disc, z_mm, keeps_in)


def make_plan(
    robot: RobotFile, view: View, request: PlanRequest, rng: np.random.Generator
) -> tuple[PlannedShot, ...]:
    """Choose identification pairs near the boundary, validation pairs all over, drift shots.

    Both kinds of pairs share one tour with little travel, so that slow effects meet them alike.
    Raise `PlanInvalid` if the workspace holds too few poses that can be taken and seen.
    """
    region = region_of(robot, view, request.centre, request.space)
    _check_centre(region)
    _check_tracker(region)
    # validation poses keep further off the joints' limits
    further = UNSEEN_JOINT_RESERVE_RAD - JOINT_RESERVE_RAD
    limits = region.limits.narrowed_by(joint=further * robot.mechanism.joints[0].scale)
    try:
        fitted = boundary_poses(region, request.identification_shots, rng)
        unseen = interior_poses(replace(region, limits=limits), 2 * request.validation_pairs, rng)
    except WorkspaceTooSmall as error:
        raise too_small(error, region, "shots") from error
    pairs = np.vstack([random_pairs(fitted, rng), random_pairs(unseen, rng) + len(fitted)])
    return ordered_shots(
        region, np.vstack([fitted, unseen]), pairs, len(fitted), request.drift_shots
    )


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
    """Make the operator's error where hardly any place is left for shots."""
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
    determines backlash.
    """
    kinematics = region.kinematics
    joints = kinematics.inverse(poses).values_or_raise()
    centre_joints = kinematics.inverse(region.centre[None]).values_or_raise()[0]
    turns, start = kinematics.comparable(joints), kinematics.comparable(centre_joints)
    tour = balance_approaches(turns, pairs, start, np.arange(len(poses)) < fitted)
    if drift_shots is None:
        drift_shots = max(FEWEST_DRIFT_SHOTS, 1 + len(tour) // PAIRS_BETWEEN)
    drift_before = np.round(np.linspace(0, len(tour), drift_shots)).astype(int).tolist()
    drift = (ShotSet.DRIFT, None, region.centre, centre_joints)
    rows: list[tuple[ShotSet, int | None, Array, Array]] = []
    for place, pair in enumerate(tour):
        rows += [drift] * drift_before.count(place)
        purpose = ShotSet.IDENTIFICATION if pair[0] < fitted else ShotSet.VALIDATION
        rows += [(purpose, place, poses[end], joints[end]) for end in pair]
    rows += [drift] * drift_before.count(len(tour))
    return tuple(
        PlannedShot(number, purpose, pair, pose_of(pose), tuple(joint.tolist()))
        for number, (purpose, pair, pose, joint) in enumerate(rows)
    )


def with_nests(
    shots: Sequence[PlannedShot], nests: Sequence[NestConfig], lengths: Sequence[KnownLengthConfig]
) -> tuple[PlannedShot, ...]:
    """Add shots of all nests behind each drift shot, the robot standing there, and renumber.

    Nests at the ends of known lengths are measured as these, the others for themselves.
    """
    bars = [bar.nests for bar in lengths if bar.nests]
    alone = [nest.name for nest in nests if not any(nest.name in bar for bar in bars)]
    pair = max((shot.pair for shot in shots if shot.pair is not None), default=-1)
    with_all: list[PlannedShot] = []
    for shot in shots:
        with_all.append(shot)
        if shot.purpose is not ShotSet.DRIFT:
            continue
        for bar in bars:
            pair += 1
            length = replace(shot, purpose=ShotSet.KNOWN_LENGTH, pair=pair)
            with_all += [replace(length, nest=name) for name in bar]
        with_all += [replace(shot, purpose=ShotSet.NEST, nest=name) for name in alone]
    return tuple(replace(shot, shot=number) for number, shot in enumerate(with_all))


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
