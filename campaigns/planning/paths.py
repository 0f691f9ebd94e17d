"""Whether the way between two poses is safe, and a way round when it is not."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from campaigns.arrays import Array, Mask
from campaigns.design.tours import travel_rad
from campaigns.mechanisms.feasibility import Limits, outside, smallest_singular_value, swing_rad
from campaigns.mechanisms.forward import forward
from campaigns.mechanisms.geometry import Geometry
from campaigns.mechanisms.par4 import forearms_mm, inverse

PATH_STEP_RAD = np.radians(5.0)
SLACK_RAD = np.radians(3.0)
"""A passing pose may exceed θ's and the forearms' limits by this; one that is measured may not."""
PASSING_SINGULARITY_MARGIN = 0.1


@dataclass(frozen=True, slots=True)
class PathFault:
    """Why a joint move is not safe."""

    reason: str
    part_of_the_way: float


def path_fault(
    geometry: Geometry, limits: Limits, from_rad: Array, to_rad: Array
) -> PathFault | None:
    """What goes wrong on the coordinated move from joints to joints, (4,) each, if anything."""
    steps = max(2, int(np.ceil(np.abs(to_rad - from_rad).max() / PATH_STEP_RAD)) + 1)
    part = np.linspace(0.0, 1.0, steps)
    joints = from_rad + part[:, None] * (to_rad - from_rad)
    solution = forward(geometry, joints)
    if not solution.found.all():
        lost = float(part[np.argmin(solution.found)])
        return PathFault("the mechanism cannot be assembled", lost)
    for reason, wrong in _passing_faults(geometry, limits, joints, solution.values):
        if wrong.any():
            return PathFault(reason, float(part[np.argmax(wrong)]))
    return None


def _passing_faults(
    geometry: Geometry, limits: Limits, joints: Array, poses: Array
) -> Iterator[tuple[str, Mask]]:
    """What a passing pose may not do, and which of the poses (N, 4) do it, (N,)."""
    theta, (low, high) = poses[:, 3], limits.theta_rad
    yield "theta leaves its limits", (theta < low - SLACK_RAD) | (theta > high + SLACK_RAD)
    swing = np.abs(swing_rad(geometry, forearms_mm(geometry, joints, poses)))
    too_far = (swing > limits.forearm_swing_rad + SLACK_RAD).any(axis=1)
    yield "a forearm swings too far", np.asarray(too_far)
    margin = smallest_singular_value(geometry, joints, poses)
    yield "it passes near a singularity", margin < PASSING_SINGULARITY_MARGIN


def route(
    geometry: Geometry, limits: Limits, from_rad: Array, to_rad: Array, centre: Array
) -> list[Array] | None:
    """Joint targets (4,) of a safe way, the last being `to_rad`; None when none was found.

    Straight if that is safe, else by poses between the two ends and the workspace's centre (4,).
    """
    if path_fault(geometry, limits, from_rad, to_rad) is None:
        return [to_rad]
    ends = forward(geometry, np.stack([from_rad, to_rad]))
    if not ends.found.all():
        return None
    for poses in _detours(ends.values[0], ends.values[1], centre):
        via = inverse(geometry, poses)
        way = [from_rad, *via.values, to_rad]
        within = not outside(via.values, limits.joint_rad).any()
        if via.found.all() and within and _is_safe(geometry, limits, way):
            return way[1:]
    return None


def _is_safe(geometry: Geometry, limits: Limits, way: list[Array]) -> bool:
    return all(path_fault(geometry, limits, here, there) is None for here, there in pairwise(way))


def _detours(from_pose: Array, to_pose: Array, centre: Array) -> Iterator[Array]:
    """Poses to pass by, (K, 4), from the shortest detour to the longest."""
    middle = 0.5 * (from_pose + to_pose)
    for pull in (0.0, 0.3, 0.6, 1.0):
        yield (middle + pull * (centre - middle))[None]
    for pull in (0.3, 0.6):
        inner = [end + pull * (centre - end) for end in (from_pose, to_pose)]
        yield np.stack([inner[0], inner[1]])
        yield np.stack([inner[0], centre, inner[1]])


Joints = tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False)
class RobotModel:
    """What ways are checked against."""

    geometry: Geometry
    limits: Limits
    centre: Array
    """A pose well inside the workspace, where detours may lead, (4,)."""


@dataclass(frozen=True, slots=True, eq=False)
class Stop:
    """A place on the way, and what the operator calls it."""

    name: str
    joints_rad: Array
    """(4,)"""


@dataclass(frozen=True, slots=True)
class PathReport:
    """What the ways between stops come to."""

    detours: int
    """How many are not straight because that would not be safe."""
    travel_rad: float
    faults: tuple[str, ...]
    """One line for each two stops between which no safe way was found."""


def check_paths(stops: Sequence[Stop], mechanism: RobotModel) -> PathReport:
    """Look for a safe way between each two stops that follow each other."""
    detours, travel, faults = 0, 0.0, []
    for here, there in pairwise(stops):
        way = safe_path(mechanism, here.joints_rad, there.joints_rad)
        if way is None:
            faults.append(_fault(mechanism, here, there))
            continue
        detours += len(way) > 1
        travel += sum(float(travel_rad(a, b)) for a, b in pairwise([here.joints_rad, *way]))
    return PathReport(detours, travel, tuple(faults))


class PathCache:
    """Safe ways, those between the stops of a plan worked out before anything moves."""

    def __init__(self, mechanism: RobotModel, stops: Sequence[Joints]) -> None:
        self._mechanism = mechanism
        self._known: dict[tuple[Joints, Joints], list[Joints]] = {}
        for here, there in pairwise(stops):
            legs = self.legs(here, there)
            if legs is not None:
                self._known[here, there] = legs

    def legs(self, here: Joints, there: Joints) -> list[Joints] | None:
        """Joint targets of a safe way, the last being `there`; None when none was found."""
        if (here, there) in self._known:
            return self._known[here, there]
        way = safe_path(self._mechanism, np.array(here), np.array(there))
        return None if way is None else [*(tuple(leg.tolist()) for leg in way[:-1]), there]


def safe_path(mechanism: RobotModel, from_rad: Array, to_rad: Array) -> list[Array] | None:
    """Joint targets (4,) of a safe way, the last being `to_rad`; None when none was found."""
    return route(mechanism.geometry, mechanism.limits, from_rad, to_rad, mechanism.centre)


def _fault(mechanism: RobotModel, here: Stop, there: Stop) -> str:
    straight = path_fault(mechanism.geometry, mechanism.limits, here.joints_rad, there.joints_rad)
    why = f"{straight.reason}, {straight.part_of_the_way:.0%} of the way" if straight else "blocked"
    return f"no safe way from {here.name} to {there.name}: {why}, and no way round"


def named_stops(names: Sequence[str], joints_rad: Array) -> list[Stop]:
    """Stops from names and joints (N, 4)."""
    return [Stop(name, np.asarray(row)) for name, row in zip(names, joints_rad, strict=True)]
