"""The tests of the paper's section IV.E as poses to command: the controller's model counts.

Repeatability, rotation, straightness and distances.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array
from campaigns.design.restricted_space import ROUNDING_MM, UNRESTRICTED, RestrictedSpace
from campaigns.errors import PlanInvalid
from campaigns.mechanisms.mechanism import (
    Axis,
    Interval,
    Kinematics,
    KinematicSolution,
    Limits,
)
from campaigns.planning.paths import RobotModel, Stop, check_paths
from campaigns.planning.plan_check import refuse, view_fault
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import View
from campaigns.planning.steps import Step
from campaigns.robots.robot import pose_of, pose_row
from campaigns.settings.sections import ValidationConfig
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Pose

APPROACH_MM = 80.0
"""Distance from which the repeated point is approached."""
SHRINK = 0.98
SHRINKS = 20
"""A line or turn that is too long for the robot is shortened about its middle, step by step."""
LINE_PROBES = 401
LINE_SPARE = 0.9
"""A line is no longer than that part of what the nominal robot can do."""
AXES = ("x", "y", "z")


Correct = Callable[[Array], KinematicSolution]


@dataclass(frozen=True, slots=True, eq=False)
class Reachable:
    """The robot as its controller believes it to be, for that is what takes pose commands.

    Or as it really is, where `correct` gives the poses to command to its controller for wanted
    ones. `view` is how the tracker sees it; None when that need not be looked at.
    """

    kinematics: Kinematics
    limits: Limits
    view: View | None = None
    space: RestrictedSpace = UNRESTRICTED
    correct: Correct | None = None

    def first_reason(self, poses: Array) -> str:
        """Reason why the first impossible one of poses (N, t) is so; empty when none is."""
        judged = self.kinematics.feasibility(self.limits, poses)
        if not judged.feasible.all():
            row = int(np.argmin(judged.feasible))
            return judged.describe(row)[0]
        beyond = (self.space.fault(pose[:3]) for pose in poses)
        if fault := next(filter(None, beyond), ""):
            return fault
        if self.correct is not None and not self.correct(poses).found.all():
            return "the controller's own kinematics cannot be assembled there"
        if self.view is None:
            return ""
        faults = (view_fault(pose[:3], self.view) for pose in poses)
        return next(filter(None, faults), "")

    def line_reason(self, poses: Array) -> str:
        """The same for poses (N, t) and the straight lines between them."""
        if reason := self.first_reason(poses):
            return reason
        clearance = self.space.line_clearance_mm(poses[:-1, :3], poses[1:, :3])
        crossed = np.flatnonzero((clearance < -ROUNDING_MM).any(axis=0))
        return f"it crosses {self.space.zones[crossed[0]].name}" if crossed.size else ""

    def joints(self, poses: Array) -> Array:
        """Joints (N, n) of poses (N, t)."""
        return self.kinematics.feasibility(self.limits, poses).joints

    def corrected(self, poses: Array) -> list[Pose | None]:
        """Poses to command for poses (N, t) where they are others."""
        if self.correct is None:
            return [None] * len(poses)
        return [pose_of(row) for row in self.correct(poses).values_or_raise()]


@dataclass(frozen=True, slots=True)
class ValidationSteps:
    """Steps of a validation; `notes` say what was shortened or left out, and why."""

    steps: tuple[Step, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Test:
    """Poses (N, t) of one test, and what was changed to make them possible."""

    purpose: ShotSet
    poses: Array
    pairs: Sequence[int | None]
    notes: tuple[str, ...] = ()
    approaches: Array | None = None
    """Poses from which each is approached, (N, t)."""


def validation_steps(
    config: ValidationConfig,
    pairs: Sequence[PlannedShot],
    robot: Reachable,
    only: frozenset[ShotSet],
    rng: np.random.Generator,
) -> ValidationSteps:
    """The steps of the tests asked for; `pairs` are the plan's validation shots.

    Raises `PlanInvalid` when a test cannot be done at all, or a way between poses is not safe.
    """
    centre = np.zeros(len(robot.kinematics.mechanism.task))
    centre[: len(AXES)] = config.centre_mm
    # pairs first: spread as they are, they tell the gate where the tracker stands
    makers: Mapping[ShotSet, Callable[[], list[_Test]]] = {
        ShotSet.VALIDATION: lambda: [_possible_pairs(pairs, robot)],
        ShotSet.ROTATION: lambda: _rotations(centre, config.rotation_steps, robot),
        ShotSet.STRAIGHTNESS: lambda: _lines(centre, config, robot),
        ShotSet.REPEATABILITY: lambda: [
            _repetitions(centre, config.repeatability_approaches, robot, rng)
        ],
    }
    tests = [test for purpose, make in makers.items() if purpose in only for test in make()]
    notes = tuple(note for test in tests for note in test.notes)
    steps = tuple(step for test in tests for step in _steps(test, robot))
    if not steps:
        why = "; ".join(notes) or "no test was named, or the plan holds no validation pairs"
        raise PlanInvalid(f"nothing to validate: {why}", remedy="name a test, or plan anew")
    numbered = tuple(
        replace(step, planned=replace(step.planned, shot=number))
        for number, step in enumerate(steps)
    )
    _check_ways(numbered, RobotModel(robot.kinematics, robot.limits, centre, robot.space))
    return ValidationSteps(numbered, notes)


def fitting_lines(
    kinematics: Kinematics, limits: Limits, centre: Array, lengths_mm: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Lengths of the lines along x, y and z through the centre, the robot being able to do them.

    Of those that are too long the longest that fits with something to spare, in whole centimetres.
    """
    robot = Reachable(kinematics, limits)

    def fitting(axis: int) -> float:
        poses = np.tile(centre, (LINE_PROBES, 1))
        poses[:, axis] += np.linspace(-0.5, 0.5, LINE_PROBES) * lengths_mm[axis]
        if not robot.first_reason(poses):
            return lengths_mm[axis]
        half = np.abs(poses[:, axis] - centre[axis])
        beyond = ~kinematics.feasibility(limits, poses).feasible
        return max(10.0, 10.0 * math.floor(0.1 * LINE_SPARE * 2.0 * float(half[beyond].min())))

    x, y, z = map(fitting, range(len(AXES)))
    return x, y, z


def _steps(test: _Test, robot: Reachable) -> list[Step]:
    """A test's steps, each still with the number 0."""
    joints = robot.joints(test.poses)
    via = [()] * len(joints) if test.approaches is None else _vias(robot, test.approaches)
    corrected = robot.corrected(test.poses)
    return [
        Step(
            PlannedShot(0, test.purpose, pair, pose_of(pose), tuple(q.tolist())),
            "pose",
            passed,
            instead,
        )
        for pose, pair, q, passed, instead in zip(
            test.poses, test.pairs, joints, via, corrected, strict=True
        )
    ]


def _vias(robot: Reachable, poses: Array) -> list[tuple[tuple[float, ...], ...]]:
    return [(tuple(q.tolist()),) for q in robot.joints(poses)]


def _check_ways(steps: Sequence[Step], robot: RobotModel) -> None:
    stops: list[Stop] = []
    for step in steps:
        name = f"{step.planned.purpose.value} shot {step.planned.shot}"
        stops += [Stop(f"the approach to {name}", np.array(q)) for q in step.approach]
        stops.append(Stop(name, np.array(step.planned.joints)))
    refuse(
        check_paths(stops, robot).faults,
        remedy="correct `validation` in campaign.yaml, or plan anew",
    )


def _possible_pairs(shots: Sequence[PlannedShot], robot: Reachable) -> _Test:
    """The pairs that the controller can take whole, and why the others are left out."""
    pairs: dict[int | None, list[PlannedShot]] = {}
    for shot in shots:
        pairs.setdefault(shot.pair, []).append(shot)
    taken: list[PlannedShot] = []
    notes: list[str] = []
    for pair, both in pairs.items():
        reason = robot.first_reason(np.array([pose_row(shot.pose) for shot in both]))
        if reason:
            notes.append(f"validation pair {pair} left out: {reason}")
        else:
            taken += both
    count = len(robot.kinematics.mechanism.task)
    poses = np.array([pose_row(shot.pose) for shot in taken]).reshape(-1, count)
    return _Test(ShotSet.VALIDATION, poses, [shot.pair for shot in taken], tuple(notes))


def _repetitions(centre: Array, count: int, robot: Reachable, rng: np.random.Generator) -> _Test:
    """Repetitions of one pose from all around it: evenly over a sphere with a random turn."""
    place = np.arange(count) + 0.5
    height = 1.0 - 2.0 * place / count
    around = np.pi * (1.0 + 5.0**0.5) * place + rng.uniform(0.0, 2.0 * np.pi)
    radius = np.sqrt(1.0 - height**2)
    directions = np.column_stack([radius * np.cos(around), radius * np.sin(around), height])
    poses, approaches = np.tile(centre, (count, 1)), np.tile(centre, (count, 1))
    approaches[:, :3] += APPROACH_MM * directions
    if reason := robot.first_reason(np.vstack([poses, approaches])):
        raise _impossible("repeatability", reason)
    return _Test(ShotSet.REPEATABILITY, poses, [None] * count, approaches=approaches)


def _rotations(centre: Array, steps: int, robot: Reachable) -> list[_Test]:
    """Turns about each task axis that has limits; none for a platform that does not turn."""
    axes = enumerate(zip(robot.kinematics.mechanism.task, robot.limits.task, strict=True))
    return [
        _rotation(centre, place, axis, interval, steps, robot)
        for place, (axis, interval) in axes
        if axis.is_revolute and interval is not None
    ]


def _rotation(
    centre: Array, place: int, axis: Axis, interval: Interval, steps: int, robot: Reachable
) -> _Test:
    low, high = interval
    values = np.linspace(low, high, steps)

    def turned(part: float) -> Array:
        poses = np.tile(centre, (steps, 1))
        poses[:, place] = part * values
        return poses

    judge = robot.first_reason
    poses, notes = _shortened(turned, judge, "rotation", axis.to_file(high - low), "°")
    return _Test(ShotSet.ROTATION, poses, [None] * steps, notes)


def _lines(centre: Array, config: ValidationConfig, robot: Reachable) -> list[_Test]:
    """The lines along x, y and z through the centre."""
    lengths = enumerate(config.line_lengths_mm)
    return [_line(centre, axis, length, config.line_points, robot) for axis, length in lengths]


def _line(centre: Array, axis: int, length_mm: float, points: int, robot: Reachable) -> _Test:
    offsets = np.linspace(-0.5, 0.5, points) * length_mm

    def along(part: float) -> Array:
        poses = np.tile(centre, (points, 1))
        poses[:, axis] += part * offsets
        return poses

    judge = robot.line_reason
    poses, notes = _shortened(along, judge, f"line along {AXES[axis]}", length_mm, " mm")
    return _Test(ShotSet.STRAIGHTNESS, poses, [None] * points, notes)


def _shortened(
    make: Callable[[float], Array],
    judge: Callable[[Array], str],
    test: str,
    asked: float,
    unit: str,
) -> tuple[Array, tuple[str, ...]]:
    """The largest version of a test that the robot can do, down to two thirds of what was asked."""
    first_reason = ""
    for part in SHRINK ** np.arange(SHRINKS):
        poses = make(float(part))
        reason = judge(poses)
        if not reason:
            used = f"{test} shortened from {asked:g} to {part * asked:.4g}{unit}: {first_reason}"
            return poses, (used,) if first_reason else ()
        first_reason = first_reason or reason
    raise _impossible(f"{test} of {asked:g}{unit}", first_reason)


def _impossible(test: str, reason: str) -> PlanInvalid:
    return PlanInvalid(
        f"{test} cannot be done with the controller's kinematics: {reason}",
        remedy="move validation.centre_mm or shorten the test in campaign.yaml, or validate "
        "without it",
    )
