"""Plan of a validation: its tests as poses to command, by the controller's model.

Repeatability, rotation, straightness and distances (the paper's section IV.E); ISO 9283's cube.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import AXES, Array, Index, Mask
from campaigns.design.pose_sampling import FeasibleRegion
from campaigns.design.restricted_space import ROUNDING_MM, UNRESTRICTED, RestrictedSpace
from campaigns.errors import PlanInvalid
from campaigns.kinematics.feasibility import Limits
from campaigns.kinematics.mechanism import Kinematics, KinematicSolution
from campaigns.kinematics.transmission import approach_along
from campaigns.planning.paths import RobotModel, Stop, check_paths
from campaigns.planning.plan_check import refuse
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.steps import Step
from campaigns.robots.robot import pose_of, pose_row
from campaigns.settings.sections import ValidationConfig
from campaigns.shots.shot_sets import ShotSet

APPROACHES_MM = (80.0, 40.0, 20.0, 10.0)
"""Distances from which the repeated point is approached: the first that a robot has room for."""
SHRINK = 0.98
SHRINKS = 20
"""A line or turn that is too long for the robot is shortened about its middle, step by step."""
SHORTEST_PART = SHRINK ** (SHRINKS - 1)
LINE_PROBES = 401
ISO_POSES = np.array([[-1, 1, 1], [1, 1, 1], [1, -1, -1], [-1, -1, -1], [0, 0, 0]], dtype=float)
"""ISO 9283's P5 to P1, in a cycle's order, on the plane C1-C2-C7-C8 of a cube with corners ± 1."""
ISO_PART = 0.8
"""P2 to P5 are a tenth of its diagonal inside the cube's corners."""
CUBE_STEPS = 40
"""Steps of the grid along the longest side of the box in which a cube is sought."""
Planned = tuple[tuple[Step, ...], tuple[str, ...]]
"""Steps, and notes that say what was shortened or left out, and why."""
Correct = Callable[[Array, Array | None], KinematicSolution]
"""Poses (N, t) to command for wanted ones, by the signs of joints' last motions there, (N, n)."""


@dataclass(frozen=True, slots=True, eq=False)
class Reachable:
    """Robot by its controller's parameters, which pose commands are taken by.

    Or the real robot, where `correct` gives the poses to command to its controller for wanted ones.
    """

    kinematics: Kinematics
    limits: Limits
    space: RestrictedSpace = UNRESTRICTED
    correct: Correct | None = None

    def first_reason(self, poses: Array) -> str:
        """Return why the first impossible one of poses (N, t) is so; empty if none is."""
        judged = self.kinematics.feasibility(self.limits, poses)
        if not judged.feasible.all():
            row = int(np.argmin(judged.feasible))
            return judged.describe(row)[0]
        for pose in poses:
            if fault := self.space.fault(pose[:3]):
                return fault
        if self.correct is not None and not self.correct(poses, None).is_solved.all():
            return "the controller's own kinematics cannot be assembled there"
        return ""

    def line_reason(self, poses: Array) -> str:
        """Return why poses (N, t) or straight lines between them are impossible; or ""."""
        if reason := self.first_reason(poses):
            return reason
        clearance = self.space.line_clearance_mm(poses[:-1, :3], poses[1:, :3])
        crossed = np.flatnonzero((clearance < -ROUNDING_MM).any(axis=0))
        return f"it crosses {self.space.zones[crossed[0]].name}" if crossed.size else ""

    def joints(self, poses: Array) -> Array:
        """Return the joints (N, n) of poses (N, t)."""
        return self.kinematics.feasibility(self.limits, poses).joints

    def corrected(self, steps: tuple[Step, ...]) -> tuple[Step, ...]:
        """Return steps, in their order, with the poses to command where they are others."""
        if self.correct is None:
            return steps
        stops = [stop for step in steps for stop in (*step.approach, step.planned.joints)]
        ends = np.cumsum([len(step.approach) + 1 for step in steps]) - 1
        sides = approach_along(np.array(stops))[ends]
        poses = np.array([pose_row(step.planned.pose) for step in steps])
        commanded = self.correct(poses, sides).values_or_raise()
        return tuple(
            replace(step, corrected=pose_of(row))
            for step, row in zip(steps, commanded, strict=True)
        )


def validation_steps(
    config: ValidationConfig,
    pairs: Sequence[PlannedShot],
    robot: Reachable,
    only: frozenset[ShotSet],
    rng: np.random.Generator,
    region: FeasibleRegion | None = None,
) -> Planned:
    """Plan the steps of the tests in `only`; `pairs` are the plan's validation shots.

    In `region`, of the nominal robot, the largest cube is sought: it is the same in both stages.
    Raise `PlanInvalid` if a test cannot be done at all, or a way between poses is not safe.
    """
    centre = np.zeros(len(robot.kinematics.mechanism.task))
    centre[: len(AXES)] = config.centre_mm
    # pairs first: spread widely, they determine where the tracker stands
    makers: Mapping[ShotSet, Callable[[], Iterator[Planned]]] = {
        ShotSet.VALIDATION: lambda: _possible_pairs(pairs, robot),
        ShotSet.ROTATION: lambda: _rotations(centre, config.rotation_steps, robot),
        ShotSet.STRAIGHTNESS: lambda: _lines(centre, config, robot),
        ShotSet.REPEATABILITY: lambda: _repetitions(
            centre, config.repeatability_approaches, robot, rng
        ),
        ShotSet.ISO_CUBE: lambda: _cube(centre, config, robot, region),
    }
    tests = [test for purpose, make in makers.items() if purpose in only for test in make()]
    steps = [step for test_steps, _ in tests for step in test_steps]
    notes = tuple(note for _, test_notes in tests for note in test_notes)
    if not steps:
        why = "; ".join(notes) or "no test was named, or the plan holds no validation pairs"
        raise PlanInvalid(f"nothing to validate: {why}", remedy="name a test, or make a new plan")
    numbered = tuple(
        replace(step, planned=replace(step.planned, shot=number))
        for number, step in enumerate(steps)
    )
    if (
        robot.correct is not None
        and not numbered[0].approach
        and not robot.first_reason(centre[None])
    ):
        # without a pose before the first one, its joints would come from an unknown side
        via = tuple(robot.joints(centre[None])[0].tolist())
        numbered = (replace(numbered[0], approach=(via,)), *numbered[1:])
    _check_ways(numbered, RobotModel(robot.kinematics, robot.limits, centre, robot.space))
    return robot.corrected(numbered), notes


def fitting_lines(
    kinematics: Kinematics,
    limits: Limits,
    centre: Array,
    lengths_mm: tuple[float, float, float],
    space: RestrictedSpace = UNRESTRICTED,
) -> tuple[float, float, float]:
    """Return the lengths of lines along x, y, z through the centre that robot and space allow.

    A line that is too long gets nine tenths of what fits, in whole centimetres.
    """
    robot = Reachable(kinematics, limits, space)

    def fitting(axis: int) -> float:
        poses = np.tile(centre, (LINE_PROBES, 1))
        poses[:, axis] += np.linspace(-0.5, 0.5, LINE_PROBES) * lengths_mm[axis]
        if not robot.first_reason(poses):
            return lengths_mm[axis]
        half = np.abs(poses[:, axis] - centre[axis])
        beyond = ~(kinematics.feasibility(limits, poses).feasible & space.allows(poses[:, :3]))
        return max(10.0, 10.0 * math.floor(0.1 * 0.9 * 2.0 * float(half[beyond].min())))

    x, y, z = map(fitting, range(len(AXES)))
    return x, y, z


def _steps(
    purpose: ShotSet,
    poses: Array,
    robot: Reachable,
    pairs: Sequence[int | None] | None = None,
    approaches: Array | None = None,
) -> tuple[Step, ...]:
    """Make steps to poses (N, t), all with the number 0, by way of `approaches` (N, t)."""
    joints, count = robot.joints(poses).tolist(), len(poses)
    passed = [()] * count if approaches is None else robot.joints(approaches).tolist()
    return tuple(
        Step(
            PlannedShot(0, purpose, pair, pose_of(pose), tuple(q)),
            "pose",
            (tuple(via),) if via else (),
        )
        for pose, pair, q, via in zip(poses, pairs or [None] * count, joints, passed, strict=True)
    )


def _check_ways(steps: Sequence[Step], robot: RobotModel) -> None:
    stops: list[Stop] = []
    for step in steps:
        name = f"{step.planned.purpose.value} shot {step.planned.shot}"
        stops += [(f"the approach to {name}", np.array(q)) for q in step.approach]
        stops.append((name, np.array(step.planned.joints)))
    refuse(
        check_paths(stops, robot).faults,
        remedy="correct `validation` in campaign.yaml, or make a new plan",
    )


def _possible_pairs(shots: Sequence[PlannedShot], robot: Reachable) -> Iterator[Planned]:
    """Plan the pairs that the controller can take whole, and note why others are left out."""
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
    numbers = [shot.pair for shot in taken]
    yield _steps(ShotSet.VALIDATION, poses, robot, numbers), tuple(notes)


def _repetitions(
    centre: Array, count: int, robot: Reachable, rng: np.random.Generator
) -> Iterator[Planned]:
    """Repeat one pose from all around it: evenly over a sphere with a random turn."""
    place = np.arange(count) + 0.5
    height = 1.0 - 2.0 * place / count
    around = np.pi * (1.0 + 5.0**0.5) * place + rng.uniform(0.0, 2.0 * np.pi)
    radius = np.sqrt(1.0 - height**2)
    directions = np.column_stack([radius * np.cos(around), radius * np.sin(around), height])
    poses, first_reason = np.tile(centre, (count, 1)), ""
    for away_mm in APPROACHES_MM:
        approaches = poses.copy()
        approaches[:, :3] += away_mm * directions
        reason = robot.first_reason(np.vstack([poses, approaches]))
        if not reason:
            steps = _steps(ShotSet.REPEATABILITY, poses, robot, approaches=approaches)
            note = f"repeatability from {away_mm:g} mm away, not {APPROACHES_MM[0]:g}"
            yield steps, (f"{note}: {first_reason}",) if first_reason else ()
            return
        first_reason = first_reason or reason
    raise _impossible("repeatability", first_reason)


def _cube(
    centre: Array, config: ValidationConfig, robot: Reachable, region: FeasibleRegion | None
) -> Iterator[Planned]:
    """Plan cycles through ISO 9283's five poses, unturned, each from the same other one."""
    edge_mm, middle = config.cube_edge_mm or 0.0, centre.copy()
    if not edge_mm and region is not None:
        middle[: len(AXES)], edge_mm = largest_cube(region)
    if not edge_mm:
        raise _impossible("ISO 9283's cube", "the workspace holds none")
    away = np.zeros((len(ISO_POSES), len(centre)))
    away[:, : len(AXES)] = 0.5 * edge_mm * ISO_PART * ISO_POSES
    poses, notes = _shortened(middle, away, robot.first_reason, "ISO 9283's cube", edge_mm, " mm")
    visits = np.tile(poses, (config.cube_cycles, 1))
    steps = _steps(ShotSet.ISO_CUBE, visits, robot, approaches=np.roll(visits, 1, axis=0))
    x_mm, y_mm, z_mm = middle[: len(AXES)].tolist()
    where = f"about [{x_mm:.0f}, {y_mm:.0f}, {z_mm:.0f}] mm"
    yield steps, (f"ISO 9283's cube of {edge_mm:.4g} mm {where}", *notes)


def largest_cube(region: FeasibleRegion) -> tuple[Array, float]:
    """Return middle (3,) and edge, mm, of the largest cube that an unturned plate can measure.

    Its edges are along the base's axes. It is sought in a grid over the region, and once more in a
    finer one around the first result. Edge 0: the region holds none.
    """
    middle, half_mm = region.centre[: len(AXES)], region.extent[: len(AXES)]
    edge_mm = 0.0
    for _ in range(2):
        step_mm = 2.0 * float(half_mm.max()) / CUBE_STEPS
        sides = [
            np.arange(at - half, at + half + 0.5 * step_mm, step_mm)
            for at, half in zip(middle, half_mm, strict=True)
        ]
        grid = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1)
        poses = np.zeros((grid[..., 0].size, len(region.centre)))
        poses[:, : len(AXES)] = grid.reshape(-1, len(AXES))
        corner, size = _largest_block(region.allows(poses).reshape(grid.shape[:-1]))
        if size < 2:
            return middle, 0.0
        edge_mm = (size - 1) * step_mm
        middle = grid[tuple(corner)] + 0.5 * edge_mm
        half_mm = np.full(len(AXES), 0.5 * edge_mm + step_mm)
    return middle, edge_mm


def _largest_block(mask: Mask) -> tuple[Index, int]:
    """Return the first corner (3,) and size of the largest cube of a mask (I, J, K) all true.

    Of cubes as large it is the one nearest to their middle; size 0: none.
    """
    counts = np.pad(mask, ((1, 0),) * 3).cumsum(0).cumsum(1).cumsum(2)
    for size in range(min(mask.shape), 0, -1):
        inside = counts
        for axis in range(len(AXES)):
            along = np.moveaxis(inside, axis, 0)
            inside = np.moveaxis(along[size:] - along[:-size], 0, axis)
        corners = np.argwhere(inside == size**3)
        if len(corners):
            away = np.linalg.norm(corners - corners.mean(axis=0), axis=1)
            return np.asarray(corners[np.argmin(away)], dtype=np.intp), size
    return np.zeros(3, dtype=np.intp), 0


def _rotations(centre: Array, steps: int, robot: Reachable) -> Iterator[Planned]:
    """Turn about each task axis that has limits; there is none if the platform only translates."""
    axes = zip(robot.kinematics.mechanism.task, robot.limits.task, strict=True)
    for place, (axis, interval) in enumerate(axes):
        if not axis.is_revolute or interval is None:
            continue
        away = np.zeros((steps, len(centre)))
        away[:, place] = np.linspace(*interval, steps)
        middle = centre.copy()
        middle[place] = 0.0
        wanted = axis.to_file(interval[1] - interval[0])
        poses, notes = _shortened(middle, away, robot.first_reason, "rotation", wanted, "°")
        yield _steps(ShotSet.ROTATION, poses, robot), notes


def _lines(centre: Array, config: ValidationConfig, robot: Reachable) -> Iterator[Planned]:
    """Plan lines along x, y and z through the centre."""
    for place, (axis, length_mm) in enumerate(zip(AXES, config.line_lengths_mm, strict=True)):
        away = np.zeros((config.line_points, len(centre)))
        away[:, place] = np.linspace(-0.5, 0.5, config.line_points) * length_mm
        name, judge = f"line along {axis}", robot.line_reason
        poses, notes = _shortened(centre, away, judge, name, length_mm, " mm")
        yield _steps(ShotSet.STRAIGHTNESS, poses, robot), notes


def _shortened(
    middle: Array, away: Array, judge: Callable[[Array], str], test: str, size: float, unit: str
) -> tuple[Array, tuple[str, ...]]:
    """Return poses `away` (N, t) from a middle (t,), shortened to what the robot can do, and why.

    Down to two thirds of the size that was requested.
    """
    first_reason = ""
    for part in SHRINK ** np.arange(SHRINKS):
        poses = middle + float(part) * away
        reason = judge(poses)
        if not reason:
            used = f"{test} shortened from {size:g} to {part * size:.4g}{unit}: {first_reason}"
            return poses, (used,) if first_reason else ()
        first_reason = first_reason or reason
    raise _impossible(f"{test} of {size:g}{unit}", first_reason)


def _impossible(test: str, reason: str) -> PlanInvalid:
    return PlanInvalid(
        f"{test} cannot be done with the controller's kinematics: {reason}",
        remedy="move validation.centre_mm or shorten the test in campaign.yaml, or validate "
        "without it",
    )
