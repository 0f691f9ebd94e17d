"""The tests of the paper's section IV.E as steps: repeatability, rotation, straightness, distances."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.config import ValidationConfig
from campaigns.errors import PlanInvalid
from campaigns.numerics.geometry import Array, Geometry
from campaigns.numerics.reach import Limits, explain, reach
from campaigns.plan_file import PlannedShot
from campaigns.planning import pose_of, pose_row
from campaigns.shot_sets import ShotSet
from campaigns.steps import Step

APPROACH_MM = 80.0
"""From how far away the repeated point is approached."""
SHRINK = 0.98
SHRINKS = 20
"""A line or turn that is too long for the robot is shortened about its middle, step by step."""
AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True, eq=False)
class Reachable:
    """The robot as the controller believes it to be: that is what takes its pose commands."""

    geometry: Geometry
    limits: Limits

    def first_reason(self, poses: Array) -> str:
        """Why the first impossible one of poses (N, 4) is impossible; empty when all are possible."""
        judged = reach(self.geometry, self.limits, poses)
        if judged.feasible.all():
            return ""
        row = int(np.argmin(judged.feasible))
        return explain(self.limits, judged, row, float(poses[row, 3]))[0]


@dataclass(frozen=True, slots=True)
class ValidationSteps:
    """What will be measured; `notes` say what was shortened or left out, and why."""

    steps: tuple[Step, ...]
    notes: tuple[str, ...]


def validation_steps(
    config: ValidationConfig,
    pairs: Sequence[PlannedShot],
    robot: Reachable,
    only: frozenset[ShotSet],
    rng: np.random.Generator,
) -> ValidationSteps:
    """The steps of the tests asked for, each commanded as a pose so that the controller's model counts.

    `pairs` are the plan's validation shots. Raises `PlanInvalid` when the centre or a validation pose
    cannot be taken.
    """
    centre = np.array([*config.centre_mm, 0.0])
    poses: list[tuple[ShotSet, int | None, Array]] = []
    notes: list[str] = []
    if ShotSet.ROTATION in only:
        turn, cut = _rotation(centre, config.rotation_steps, robot)
        poses += [(ShotSet.ROTATION, None, pose) for pose in turn]
        notes += cut
    if ShotSet.STRAIGHTNESS in only:
        for axis, length in enumerate(config.line_lengths_mm):
            line, cut = _line(centre, axis, length, config.line_points, robot)
            poses += [(ShotSet.STRAIGHTNESS, None, pose) for pose in line]
            notes += cut
    if ShotSet.VALIDATION in only:
        taken, left_out = _possible_pairs(pairs, robot)
        poses += [(ShotSet.VALIDATION, s.pair, pose_row(s.pose)) for s in taken]
        notes += left_out
    if ShotSet.REPEATABILITY in only:
        approaches = _approaches(centre, config.repeatability_approaches, rng)
        poses += [(ShotSet.REPEATABILITY, None, centre)] * len(approaches)
    else:
        approaches = np.empty((0, 4))
    steps = _steps(poses, robot, approaches)
    return ValidationSteps(steps, tuple(notes))


def _steps(
    poses: Sequence[tuple[ShotSet, int | None, Array]], robot: Reachable, approaches: Array
) -> tuple[Step, ...]:
    if not poses:
        raise PlanInvalid("nothing to validate", remedy="name at least one test with --only")
    rows = np.array([pose for _, _, pose in poses])
    why = robot.first_reason(np.vstack([rows, approaches]))
    if why:
        raise PlanInvalid(
            f"a validation pose cannot be taken with the controller's geometry: {why}",
            remedy="correct `validation` in campaign.yaml, or plan anew",
        )
    joints = reach(robot.geometry, robot.limits, rows).joints_rad
    via = iter(_joint_tuples(robot, approaches))
    steps = []
    for number, ((purpose, pair, pose), joint) in enumerate(zip(poses, joints, strict=True)):
        planned = PlannedShot(number, purpose, pair, pose_of(pose), tuple(joint.tolist()))
        approach = (next(via),) if purpose is ShotSet.REPEATABILITY else ()
        steps.append(Step(planned, "pose", approach))
    return tuple(steps)


def _possible_pairs(
    shots: Sequence[PlannedShot], robot: Reachable
) -> tuple[list[PlannedShot], list[str]]:
    """The shots of pairs that the controller can take whole, and why the others are left out."""
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
    return taken, notes


def _joint_tuples(robot: Reachable, poses: Array) -> Iterator[tuple[float, ...]]:
    if len(poses):
        for joints in reach(robot.geometry, robot.limits, poses).joints_rad:
            yield tuple(joints.tolist())


def _approaches(centre: Array, count: int, rng: np.random.Generator) -> Array:
    """Poses around the centre, evenly over the sphere with a random turn, (count, 4)."""
    place = np.arange(count) + 0.5
    height = 1.0 - 2.0 * place / count
    around = np.pi * (1.0 + 5.0**0.5) * place + rng.uniform(0.0, 2.0 * np.pi)
    radius = np.sqrt(1.0 - height**2)
    directions = np.column_stack([radius * np.cos(around), radius * np.sin(around), height])
    poses = np.tile(centre, (count, 1))
    poses[:, :3] += APPROACH_MM * directions
    return poses


def _rotation(centre: Array, steps: int, robot: Reachable) -> tuple[Array, list[str]]:
    low, high = robot.limits.theta_rad
    angles = np.linspace(low, high, steps)

    def turned(part: float) -> Array:
        poses = np.tile(centre, (steps, 1))
        poses[:, 3] = part * angles
        return poses

    asked = float(np.degrees(high - low))
    return _fitted(turned, robot, "rotation", asked, "°")


def _line(
    centre: Array, axis: int, length_mm: float, points: int, robot: Reachable
) -> tuple[Array, list[str]]:
    offsets = np.linspace(-0.5, 0.5, points) * length_mm

    def along(part: float) -> Array:
        poses = np.tile(centre, (points, 1))
        poses[:, axis] += part * offsets
        return poses

    return _fitted(along, robot, f"line along {AXES[axis]}", length_mm, "mm")


def _fitted(
    make: Callable[[float], Array], robot: Reachable, test: str, asked: float, unit: str
) -> tuple[Array, list[str]]:
    """The largest version of a test that the robot can do, down to two thirds of what was asked."""
    part, first_reason = 1.0, ""
    for _ in range(SHRINKS):
        poses = make(part)
        reason = robot.first_reason(poses)
        if not reason:
            used = f"{test} shortened from {asked:g} to {part * asked:.4g} {unit}: {first_reason}"
            return poses, [used] if first_reason else []
        first_reason = first_reason or reason
        part *= SHRINK
    raise PlanInvalid(
        f"{test} of {asked:g} {unit} cannot be done: {first_reason}",
        remedy="move validation.centre_mm, or shorten it in campaign.yaml",
    )
