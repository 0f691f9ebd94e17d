"""Paths between poses: whether a joint move is safe, a way round where not, each leg of a plan."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from campaigns.arrays import Array
from campaigns.design.tours import travel_rad
from campaigns.mechanisms.mechanism import Axis, Kinematics, Limits, Violation, outside

PATH_STEP_RAD = np.radians(5.0)
SLACK_RAD = np.radians(3.0)
"""A passing pose may exceed limits of turn and swing by this; one that is measured may not."""
PASSING_SINGULARITY_MARGIN = 0.1


@dataclass(frozen=True, slots=True)
class PathFault:
    """Reason why a joint move is not safe."""

    reason: str
    part_of_the_way: float


def path_fault(
    kinematics: Kinematics, limits: Limits, start: Array, end: Array
) -> PathFault | None:
    """First fault on the coordinated move from joints to joints, (n,) each, if any."""
    turn = np.abs(kinematics.comparable(end - start)).max()
    steps = max(2, int(np.ceil(turn / PATH_STEP_RAD)) + 1)
    part = np.linspace(0.0, 1.0, steps)
    joints = start + part[:, None] * (end - start)
    solution = kinematics.forward(joints)
    if not solution.found.all():
        lost = float(part[np.argmin(solution.found)])
        return PathFault("the mechanism cannot be assembled", lost)
    passing = _passing_limits(limits)
    mechanism = kinematics.mechanism
    passed = mechanism.passage(kinematics.p, passing, joints, solution.values)
    limited = (axis.name for axis, each in zip(mechanism.task, limits.task, strict=True) if each)
    reasons = {
        Violation.TASK_LIMIT: f"{', '.join(limited)} leaves its limits",
        Violation.SWING_LIMIT: "a forearm swings too far",
        Violation.SINGULAR: "it passes near a singularity",
        Violation.ABOVE_ELBOWS: "the platform rises above its arms' ends",
    }
    for violation, reason in reasons.items():
        wrong = passed.violations & violation != 0
        if wrong.any():
            return PathFault(reason, float(part[np.argmax(wrong)]))
    return None


def _passing_limits(limits: Limits) -> Limits:
    """Limits of a pose that is passed, not measured."""
    wider = limits.drawn_in(task=-SLACK_RAD, swing_rad=-SLACK_RAD)
    return replace(wider, singularity_margin=PASSING_SINGULARITY_MARGIN, elbow_margin=0.0)


def route(
    kinematics: Kinematics, limits: Limits, start: Array, end: Array, centre: Array
) -> list[Array] | None:
    """Joint targets (n,) of a safe way, the last being `end`; None when none was found.

    Straight if that is safe, else by poses between the two ends and the workspace's centre (t,).
    """
    if path_fault(kinematics, limits, start, end) is None:
        return [end]
    ends = kinematics.forward(np.stack([start, end]))
    if not ends.found.all():
        return None
    for poses in _detours(ends.values[0], ends.values[1], centre):
        via = kinematics.inverse(poses)
        way = [start, *via.values, end]
        within = not outside(via.values, limits.joint).any()
        if via.found.all() and within and _is_safe(kinematics, limits, way):
            return way[1:]
    return None


def _is_safe(kinematics: Kinematics, limits: Limits, way: list[Array]) -> bool:
    return all(path_fault(kinematics, limits, here, there) is None for here, there in pairwise(way))


def _detours(from_pose: Array, to_pose: Array, centre: Array) -> Iterator[Array]:
    """Poses to pass by, (K, t), from the shortest detour to the longest."""
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
    """Robot against which ways are checked."""

    kinematics: Kinematics
    limits: Limits
    centre: Array
    """A pose well inside the workspace, where detours may lead, (t,)."""

    def safe_path(self, start: Array, end: Array) -> list[Array] | None:
        """Joint targets (n,) of a safe way, the last being `end`; None when none was found."""
        return route(self.kinematics, self.limits, start, end, self.centre)


@dataclass(frozen=True, slots=True, eq=False)
class Stop:
    """Place on the way, and what the operator calls it."""

    name: str
    joints: Array
    """(n,)"""


@dataclass(frozen=True, slots=True)
class PathReport:
    """Sum of the ways between stops."""

    detours: int
    """Number of ways that are not straight because that would not be safe."""
    travel_rad: float
    """Travel of cranks, or what compares with it."""
    faults: tuple[str, ...]
    """Lines, one for each two stops between which no safe way was found."""


def check_paths(stops: Sequence[Stop], robot: RobotModel) -> PathReport:
    """Look for a safe way between each two stops that follow each other."""
    detours, travel, faults = 0, 0.0, []
    for here, there in pairwise(stops):
        way = robot.safe_path(here.joints, there.joints)
        if way is None:
            faults.append(_fault(robot, here, there))
            continue
        detours += len(way) > 1
        turns = [robot.kinematics.comparable(joints) for joints in (here.joints, *way)]
        travel += sum(float(travel_rad(a, b)) for a, b in pairwise(turns))
    return PathReport(detours, travel, tuple(faults))


class PathCache:
    """Safe ways, those between the stops of a plan worked out before anything moves."""

    def __init__(self, robot: RobotModel, stops: Sequence[Joints]) -> None:
        self._robot = robot
        self._known: dict[tuple[Joints, Joints], list[Joints]] = {}
        for here, there in pairwise(stops):
            legs = self.legs(here, there)
            if legs is not None:
                self._known[here, there] = legs

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Joint axes of the robot."""
        return self._robot.kinematics.mechanism.joints

    def legs(self, here: Joints, there: Joints) -> list[Joints] | None:
        """Joint targets of a safe way, the last being `there`; None when none was found."""
        if (here, there) in self._known:
            return self._known[here, there]
        way = self._robot.safe_path(np.array(here), np.array(there))
        return None if way is None else [*(tuple(leg.tolist()) for leg in way[:-1]), there]


def _fault(robot: RobotModel, here: Stop, there: Stop) -> str:
    straight = path_fault(robot.kinematics, robot.limits, here.joints, there.joints)
    why = f"{straight.reason}, {straight.part_of_the_way:.0%} of the way" if straight else "blocked"
    return f"no safe way from {here.name} to {there.name}: {why}, and no way round"
