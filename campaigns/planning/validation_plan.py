"""Plan of a validation: its tests as poses to command, by the controller's model.

Four tests are the paper's (Corbel 2006, IV.E): distances of unseen pairs, rotation about a fixed
point, straight lines along x, y and z, and repeatability of one pose. The fifth is ISO 9283's: five
poses in a cube, visited in cycles.

1. Each test is laid out about the workspace's centre as campaign.yaml wants it.
2. What the robot cannot do is shortened step by step, down to two thirds, and pairs are left out
   whole; a note says what and why. A test that is impossible even then is an error.
3. Steps of all tests are numbered, and the ways between them are checked.
4. For a controller that keeps its nominal parameters, poses to command are corrected last.

Steps are commanded as poses, other than those of an identification: it is the controller's own
kinematics that a validation tests. So feasibility is judged by the controller's parameters.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import AXES, Array, Index, Mask
from campaigns.design.pose_sampling import FeasibleRegion
from campaigns.design.restricted_space import ROUNDING_MM, UNRESTRICTED, RestrictedSpace
from campaigns.errors import PlanInvalid
from campaigns.kinematics.axes import Interval
from campaigns.kinematics.feasibility import Limits
from campaigns.kinematics.model import Kinematics, KinematicSolution
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
"""Factor by which a line or turn that is too long for the robot is shortened at each trial."""
SHRINKS = 20
"""Number of trials, the first at full length."""
SHORTEST_PART = SHRINK ** (SHRINKS - 1)
"""Smallest part of a line or turn that is tried: 0.68."""
LINE_PROBES = 401
"""Number of points at which a line or turn is tried for the length that fits."""
ISO_POSES = np.array([[-1, 1, 1], [1, 1, 1], [1, -1, -1], [-1, -1, -1], [0, 0, 0]], dtype=float)
"""ISO 9283's P5 to P1, in a cycle's order, on the plane C1-C2-C7-C8 of a cube with corners ± 1."""
ISO_PART = 0.8
"""Distance of P2 to P5 from the cube's middle over its corners': a tenth of a diagonal inside."""
CUBE_STEPS = 40
"""Number of grid steps along the longest side of the box in which a cube is sought."""
Planned = tuple[tuple[Step, ...], tuple[str, ...]]
"""Steps, and notes on what was shortened or left out, with the reason."""
Correct = Callable[[Array, Array | None], KinematicSolution]
"""Function from wanted poses (N, t) and the signs of the joints' last motions (N, n), or None where
these are not known, to the poses to command."""


@dataclass(frozen=True, slots=True, eq=False)
class Reachable:
    """Robot by which a validation's poses are judged.

    Its parameters are the controller's, by which pose commands are executed; or, with `correct`,
    the real robot's, and the controller is commanded to corrected poses.
    """

    kinematics: Kinematics
    limits: Limits
    space: RestrictedSpace = UNRESTRICTED
    correct: Correct | None = None
    """Correction of the poses to command; None: wanted poses are commanded."""

    def first_reason(self, poses: Array) -> str:
        """Return why the first impossible one of poses (N, t) is impossible; "" if none is."""
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
        """Return the nominal robot's joints (N, n) at poses (N, t), NaN out of its reach."""
        return self.kinematics.feasibility(self.limits, poses).joints

    def corrected(self, steps: tuple[Step, ...]) -> tuple[Step, ...]:
        """Return steps, in their order, with the corrected poses to command, if there are any."""
        if self.correct is None:
            return steps
        # A correction depends on backlash, so on the side that each joint comes from at the step:
        # signs are followed along all stops, and taken at the last stop of each step.
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

    `region` is where the largest cube is sought, and shows how far turns keep the reflector in
    sight; it is of the nominal robot, so that tests before and after a load are equal. Raise
    `PlanInvalid` if a test cannot be done at all, or a way between poses is not safe.
    """
    centre = robot.kinematics.mechanism.home_at(config.centre_mm)
    # 1. The tests. Pairs come first: spread widely, they determine where the tracker stands.
    makers: Mapping[ShotSet, Callable[[], Iterator[Planned]]] = {
        ShotSet.VALIDATION: lambda: _possible_pairs(pairs, robot),
        ShotSet.ROTATION: lambda: _rotations(centre, config.rotation_steps, robot, region),
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
    # 2. Numbers in the order of all tests.
    numbered = tuple(
        replace(step, planned=replace(step.planned, shot=number))
        for number, step in enumerate(steps)
    )
    if (
        robot.correct is not None
        and not numbered[0].approach
        and not robot.first_reason(centre[None])
    ):
        # The first step's joints would come from an unknown side, which its correction needs: so
        # the robot passes the centre before.
        via = tuple(robot.joints(centre[None])[0].tolist())
        numbered = (replace(numbered[0], approach=(via,)), *numbered[1:])
    # 3. Ways are of the wanted poses: corrected ones bring the real robot to these.
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

    # A line is symmetric about the centre, so the impossible point nearest to the centre limits it.
    def fitting_mm(axis: int) -> float:
        if kinematics.mechanism.task[axis].is_fixed:
            return lengths_mm[axis]  # there will be no such line
        poses = np.tile(centre, (LINE_PROBES, 1))
        poses[:, axis] += np.linspace(-0.5, 0.5, LINE_PROBES) * lengths_mm[axis]
        if not robot.first_reason(poses):
            return lengths_mm[axis]
        half = np.abs(poses[:, axis] - centre[axis])
        beyond = ~(kinematics.feasibility(limits, poses).feasible & space.allows(poses[:, :3]))
        return max(10.0, 10.0 * math.floor(0.1 * 0.9 * 2.0 * float(half[beyond].min())))

    x_mm, y_mm, z_mm = map(fitting_mm, range(len(AXES)))
    return x_mm, y_mm, z_mm


def _steps(
    purpose: ShotSet,
    poses: Array,
    robot: Reachable,
    pairs: Sequence[int | None] | None = None,
    approaches: Array | None = None,
) -> tuple[Step, ...]:
    """Make steps to poses (N, t), each after its pose of `approaches` (N, t) if there are any.

    Steps have the number 0 until all tests are together.
    """
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
    """Raise `PlanInvalid` if there is no safe way between two stops of the steps."""
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
    # Only poses are taken from the plan: its joints are the nominal robot's, and the controller may
    # hold other parameters by now.
    pairs: dict[int | None, list[PlannedShot]] = {}
    for shot in shots:
        pairs.setdefault(shot.pair, []).append(shot)
    possible: list[PlannedShot] = []
    notes: list[str] = []
    for pair, pair_shots in pairs.items():
        reason = robot.first_reason(np.array([pose_row(shot.pose) for shot in pair_shots]))
        if reason:
            notes.append(f"validation pair {pair} left out: {reason}")
        else:
            possible += pair_shots
    coordinates = len(robot.kinematics.mechanism.task)
    poses = np.array([pose_row(shot.pose) for shot in possible]).reshape(-1, coordinates)
    numbers = [shot.pair for shot in possible]
    yield _steps(ShotSet.VALIDATION, poses, robot, numbers), tuple(notes)


def _repetitions(
    centre: Array, count: int, robot: Reachable, rng: np.random.Generator
) -> Iterator[Planned]:
    """Repeat one pose from all around it: evenly over a sphere with a random turn.

    A robot in a plane comes from evenly around a circle.
    """
    # 1. Directions on a golden spiral (Fibonacci lattice): equal steps of height are equal areas of
    #    a sphere, and turning on by π (1 + √5) each time never repeats. The random turn keeps any
    #    one direction from being special.
    place = np.arange(count) + 0.5
    height = 1.0 - 2.0 * place / count
    if robot.kinematics.mechanism.is_planar:
        height[:] = 0.0
    around = np.pi * (1.0 + 5.0**0.5) * place + rng.uniform(0.0, 2.0 * np.pi)
    radius = np.sqrt(1.0 - height**2)
    directions = np.column_stack([radius * np.cos(around), radius * np.sin(around), height])
    # 2. The largest distance at which all approaches are possible; the reason that is noted is that
    #    of the distance that was wanted.
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
    """Plan cycles through ISO 9283's five poses, unturned, each from the same other one.

    A robot in a plane visits their projections: corners and middle of a square.
    """
    # 1. The cube: of the size in campaign.yaml about the centre, or the largest there is.
    edge_mm, middle = config.cube_edge_mm or 0.0, centre.copy()
    if not edge_mm and region is not None:
        middle[: len(AXES)], edge_mm = largest_cube(region)
    if not edge_mm:
        raise _impossible("ISO 9283's cube", "the workspace holds none")
    # 2. Its five poses, and cycles through them. The pose before each in the cycle is its approach,
    #    also in the first cycle: by ISO 9283 a pose is repeated from one direction.
    away = np.zeros((len(ISO_POSES), len(centre)))
    moving = [axis in robot.kinematics.mechanism.line_axes for axis in AXES]
    away[:, : len(AXES)] = 0.5 * edge_mm * ISO_PART * ISO_POSES * moving
    poses, notes = _shortened(middle, away, robot.first_reason, "ISO 9283's cube", edge_mm, " mm")
    visits = np.tile(poses, (config.cube_cycles, 1))
    steps = _steps(ShotSet.ISO_CUBE, visits, robot, approaches=np.roll(visits, 1, axis=0))
    x_mm, y_mm, z_mm = middle[: len(AXES)].tolist()
    where = f"about [{x_mm:.0f}, {y_mm:.0f}, {z_mm:.0f}] mm"
    yield steps, (f"ISO 9283's cube of {edge_mm:.4g} mm {where}", *notes)


def largest_cube(region: FeasibleRegion) -> tuple[Array, float]:
    """Return middle (3,) and edge, mm, of the largest cube that an unturned plate can measure.

    Its edges are along the base's axes. Edge 0: the region holds none. Of a robot in a plane it is
    the largest square.
    """
    # A grid over the region's box is judged point by point, and the largest block of good points
    # sought in it; then once more in a finer grid, about the first cube and one step around it.
    middle, half_mm = region.centre[: len(AXES)], region.extent[: len(AXES)]
    edge_mm, moving = 0.0, int(np.count_nonzero(half_mm))
    for _ in range(2):
        step_mm = 2.0 * float(half_mm.max()) / CUBE_STEPS
        sides = [
            np.arange(at - half, at + half + 0.5 * step_mm, step_mm)
            for at, half in zip(middle, half_mm, strict=True)
        ]
        grid = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1)
        poses = np.zeros((grid[..., 0].size, len(region.centre)))
        poses[:, : len(AXES)] = grid.reshape(-1, len(AXES))
        # the one step of a plane's z counts for no size
        allowed = region.allows(poses).reshape(grid.shape[:-1][:moving])
        corner, size = _largest_block(allowed)
        if size < 2:
            return middle, 0.0
        edge_mm = (size - 1) * step_mm
        middle = middle.copy()
        middle[:moving] = [
            side[at] + 0.5 * edge_mm for side, at in zip(sides, corner, strict=False)
        ]
        half_mm = np.where(np.arange(len(AXES)) < moving, 0.5 * edge_mm + step_mm, 0.0)
    return middle, edge_mm


def _largest_block(mask: Mask) -> tuple[Index, int]:
    """Return the first corner and size of the largest cube of a mask that is all true.

    The mask is (I, J, K), or (I, J) for a square. Of several largest cubes it is the one nearest to
    their mean; size 0: none.
    """
    # Sums over cubes of any size come from cumulative sums along the three axes (a summed-area
    # table): a difference along each axis in turn leaves the count of true points in each cube.
    counts = np.pad(mask, ((1, 0),) * mask.ndim).astype(np.intp)
    for axis in range(mask.ndim):
        counts = counts.cumsum(axis)
    for size in range(min(mask.shape), 0, -1):
        inside = counts
        for axis in range(mask.ndim):
            along = np.moveaxis(inside, axis, 0)
            inside = np.moveaxis(along[size:] - along[:-size], 0, axis)
        corners = np.argwhere(inside == size**mask.ndim)
        if len(corners):
            away = np.linalg.norm(corners - corners.mean(axis=0), axis=1)
            return np.asarray(corners[np.argmin(away)], dtype=np.intp), size
    return np.zeros(mask.ndim, dtype=np.intp), 0


def _rotations(
    centre: Array, steps: int, robot: Reachable, region: FeasibleRegion | None
) -> Iterator[Planned]:
    """Turn about each task axis that has limits; there is none if the platform only translates."""
    axes = zip(robot.kinematics.mechanism.task, robot.limits.task, strict=True)
    for place, (axis, interval) in enumerate(axes):
        if not axis.is_revolute or interval is None:
            continue
        (low, high), notes = _seen_turns(centre, place, interval, region)
        middle, away = centre.copy(), np.zeros((steps, len(centre)))
        middle[place] = 0.5 * (low + high)
        away[:, place] = np.linspace(low, high, steps) - middle[place]
        wanted = axis.to_file(high - low)
        poses, shortened = _shortened(middle, away, robot.first_reason, "rotation", wanted, "°")
        yield _steps(ShotSet.ROTATION, poses, robot), notes + shortened


# A reflector on a platform of one's own turns with it: beyond its acceptance angle it is lost.
def _seen_turns(
    centre: Array, place: int, limits: Interval, region: FeasibleRegion | None
) -> tuple[Interval, tuple[str, ...]]:
    """Return the longest range of one turn at the centre, rad, where the tracker sees it.

    With a note if that is not all from limit to limit.
    """
    if region is None:
        return limits, ()
    turns, poses = np.linspace(*limits, LINE_PROBES), np.tile(centre, (LINE_PROBES, 1))
    poses[:, place] = turns
    away_rad = region.incidence_rad(poses)
    seen = np.flatnonzero(away_rad <= region.acceptance_rad)
    if len(seen) in (0, LINE_PROBES):  # a centre that is not seen is named by the plan
        return limits, ()
    longest = max(np.split(seen, np.flatnonzero(np.diff(seen) > 1) + 1), key=len)
    low, high = turns[longest[[0, -1]]].tolist()
    size, part = np.degrees([limits[1] - limits[0], high - low])
    note = (
        f"rotation shortened from {size:g} to {part:.4g}°: the reflector turns "
        f"{np.degrees(away_rad.max()):.0f}° from the tracker, "
        f"limit {np.degrees(region.acceptance_rad):g}°"
    )
    return (low, high), (note,)


def _lines(centre: Array, config: ValidationConfig, robot: Reachable) -> Iterator[Planned]:
    """Plan lines along x, y and z through the centre, those along which the robot moves."""
    moving = robot.kinematics.mechanism.line_axes
    for place, (axis, length_mm) in enumerate(zip(AXES, config.line_lengths_mm, strict=True)):
        if axis not in moving:
            continue
        away = np.zeros((config.line_points, len(centre)))
        away[:, place] = np.linspace(-0.5, 0.5, config.line_points) * length_mm
        name, judge = f"line along {axis}", robot.line_reason
        poses, notes = _shortened(centre, away, judge, name, length_mm, " mm")
        yield _steps(ShotSet.STRAIGHTNESS, poses, robot), notes


def _shortened(
    middle: Array, away: Array, judge: Callable[[Array], str], test: str, size: float, unit: str
) -> tuple[Array, tuple[str, ...]]:
    """Return poses `away` (N, t) from a middle (t,), shortened to what the robot can do.

    With a note if they are shortened. `judge` returns why poses are impossible, or ""; `size` in
    `unit` is the requested one. Raise `PlanInvalid` if two thirds of it are impossible as well.
    """
    # The reason to be named is that of the full size: later trials may fail for another one.
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
    """Return the error for a test that the robot cannot do, however it is shortened."""
    return PlanInvalid(
        f"{test} cannot be done with the controller's kinematics: {reason}",
        remedy="move validation.centre_mm or shorten the test in campaign.yaml, or validate "
        "without it",
    )
