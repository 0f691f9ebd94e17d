"""Campaigns of robots of single rods: planned, measured between steps and drifts, and compared.

`measure` measures a plan of a true robot in a situation (`benchmarks.truths`): it changes the robot
or the tracker's stand between shots, lets the stand drift, adds the tracker's noise as it is
stated, and spoils the wrong shots. `position_error_um` compares an identified robot with the truth.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import resources
from os import getpid
from pathlib import Path
from tempfile import gettempdir
from typing import Any

import numpy as np

from benchmarks.truths import (
    ROBOTS,
    STEPS,
    PlannedShots,
    Situation,
    Streams,
    Term,
    TrueRobot,
    arm_of,
    directions,
    stated_reflector_mm,
)
from campaigns.arrays import Array
from campaigns.fit.rigid_transforms import fit_transform
from campaigns.robots.robot import RobotFile
from pkmcal import Shots, find_robot, plan, sample_workspace
from sim.geometry import LENGTHS, PlateKind
from sim.robot.rods import rotation

TRACKER_MM = np.array([2500.0, 0.0, -500.0])
MM_PER_DEG = 6.0
"""Travel of a carriage that compares with 1° of a crank."""
POSES = 150
"""Poses of the workspace at which positions are compared."""
PLANS_FOLDER = Path(gettempdir()) / "pkmcal-plans"
PLANS = 8
"""Plans of each mechanism and number of shots, by the campaigns' seeds in turn."""


def streams_of(mechanism: str, seed: int) -> Streams:
    """Return the generators of a campaign, which are the same in all situations."""
    return Streams((seed, list(ROBOTS).index(mechanism)))


def planned_shots(mechanism: str, shots: int, seed: int, folder: Path) -> PlannedShots:
    """Return the nominal robot's plan for a campaign's seed, made once and kept in a folder."""
    number = 1 + seed % PLANS
    file = folder / f"{mechanism}-{shots}-{number}.json"
    if not file.exists():
        robot = find_robot(ROBOTS[mechanism])
        made = plan(robot, TRACKER_MM.tolist(), shots=shots, seed=number)
        joints = np.array([shot.joints for shot in made.shots])
        document = {
            "joints": joints.tolist(),
            "poses": robot.kinematics.forward(joints).values_or_raise().tolist(),
            "sets": [shot.purpose.value for shot in made.shots],
            "pairs": [shot.pair for shot in made.shots],
        }
        _written_once(file, json.dumps(document))
    read = json.loads(file.read_text(encoding="utf-8"))
    joints, poses = np.array(read["joints"]), np.array(read["poses"])
    return PlannedShots(joints, poses, tuple(read["sets"]), tuple(read["pairs"]))


def nominal_robot(mechanism: str, folder: Path, *, is_reflector_stated: bool) -> RobotFile:
    """Return a shipped robot, or one by a copy of its file that says where the reflector is."""
    name = ROBOTS[mechanism]
    if not is_reflector_stated:
        return find_robot(name)
    text = (resources.files("campaigns.robots") / f"{name}.yaml").read_text(encoding="utf-8")
    text += f"reflector_mm: {stated_reflector_mm(name).tolist()}\n"
    return find_robot(_written_once(folder / f"{name}-stated.yaml", text))


def _written_once(file: Path, text: str) -> Path:
    """Write a file whole, since another process may write the same one at this moment."""
    file.parent.mkdir(parents=True, exist_ok=True)
    draft = file.with_name(f"{file.name}.{getpid()}")
    draft.write_text(text, encoding="utf-8")
    return draft.replace(file)


@lru_cache
def _workspace(mechanism: str) -> Array:
    """Return the poses at which positions are compared, (N, t)."""
    return sample_workspace(find_robot(ROBOTS[mechanism]), POSES, seed=99)


def position_error_um(nominal: RobotFile, truth: TrueRobot, result: Any) -> float:
    """Return the rms error of poses that the identified robot is to take, in the best frame.

    Raise `CampaignError` if the result is no robot, `AssemblyLost` if the true one cannot do it.
    """
    values = result.value.flat()
    robot = nominal.of(nominal.mechanism, values, name="identified", limits=nominal.limits)
    poses = _workspace(nominal.mechanism.name)
    inverse = robot.kinematics.inverse(poses)
    poses, joints = poses[inverse.is_solved], inverse.values[inverse.is_solved]
    true = truth.points(joints, np.zeros(joints.shape), poses)
    left = fit_transform(poses[:, :3], true).apply(poses[:, :3]) - true
    return 1e3 * float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


@dataclass(frozen=True, slots=True, eq=False)
class TrueStep:
    """A part that changed between two shots: which, where in time, and by how much."""

    part: str
    """`encoder 1`, as findings name it, or `frame`."""
    first: int
    """Row of the first shot after it."""
    end: int
    """Row after the last one."""
    size: float
    """deg or mm."""
    flat: Mapping[str, float]
    """Changes of the robot's parameters by name."""
    shift_mm: Array
    """(3,): motion of the points seen from the tracker."""

    @property
    def is_of_place(self) -> bool:
        """Whether the part moved, in a direction: findings have the size along one axis."""
        return self.part == "frame" or self.part.startswith("mount")

    def is_on(self, count: int) -> Array:
        """Return whether each of `count` shots is after it, and before it was taken back."""
        rows = np.arange(count)
        return np.asarray((rows >= self.first) & (rows < self.end))


def resolve_step(term: Term, kind: PlateKind, planned: PlannedShots, streams: Streams) -> TrueStep:
    """Return what a step changes in a plan's campaign."""
    fitted, count = planned.fitted, len(planned.joints)
    first = count - term.last if term.last else int(fitted[planned.scaled(term.since or 0)])
    end = count if term.until is None else int(fitted[planned.scaled(term.until)]) + 1
    way = term.size * streams.direction(f"way of {term.effect}")
    if term.effect == "stand":
        return TrueStep("frame", first, end, term.size, {}, way)
    arm, size = arm_of(streams, term.effect, kind.arms), term.size
    name, still = f"arm{arm}", np.zeros(3)
    if term.effect == "encoder":
        size *= MM_PER_DEG if kind.on_rails else 1.0
        flat = {f"{name}.joint_offset_{kind.unit}": size}
    elif term.effect == "mount":
        keys = (f"{name}.{axis}_mm" for axis in "xyz")
        flat = dict(zip(keys, way.tolist(), strict=True))
    else:
        flat = {f"{name}.{term.effect}_mm": size}
    return TrueStep(f"{term.effect} {arm}", first, end, size, flat, still)


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A campaign: its shots, the robot after the last one, and what was wrong by truth."""

    now: TrueRobot
    shots: Shots
    wrong: frozenset[int]
    """Numbers of the wrong shots."""
    steps: tuple[TrueStep, ...]


def changed_robot(truth: TrueRobot, steps: list[TrueStep]) -> TrueRobot:
    """Return a robot of which some parts have changed."""
    flat = dict(truth.flat)
    for step in steps:
        for name, change in step.flat.items():
            flat[name] += change
    return replace(truth, flat=flat)


def settled_robot(truth: TrueRobot, streams: Streams) -> TrueRobot:
    """Return a robot some time later: screws have settled, and joints were homed again."""
    rng, flat = streams.of("settled"), dict(truth.flat)
    for name, (_, part) in truth.kind.parameters.items():
        spread = 0.01 if part.stem in ("x", "y", "z") else 0.005 if part.stem in LENGTHS else 0.0
        if part.stem == "joint_offset":
            spread = 0.002 if part.unit == "deg" else 0.01
        flat[name] += spread * float(rng.standard_normal())
    return replace(truth, flat=flat)


def measure(
    nominal: RobotFile,
    truth: TrueRobot,
    situation: Situation,
    planned: PlannedShots,
    streams: Streams,
) -> Measured:
    """Measure a plan of a true robot; raise `AssemblyLost` where that has no pose."""
    count = len(planned.joints)
    steps = [resolve_step(term, truth.kind, planned, streams) for term in situation.of(*STEPS)]
    sides = streams.of("sides").choice([-1.0, 1.0], planned.joints.shape)
    way = np.diff(planned.joints, axis=0, prepend=planned.joints[:1])
    true_joints = planned.joints - 0.01 * situation.size("lag") * way
    # Shots between the same steps see one robot: the rods are built once for each such span.
    is_on = np.array([step.is_on(count) for step in steps]).reshape(-1, count)
    points = np.empty((count, 3))
    for pattern in np.unique(is_on, axis=1).T:
        rows = (is_on == pattern[:, None]).all(axis=0)
        robot = changed_robot(truth, [s for s, on in zip(steps, pattern, strict=True) if on])
        points[rows] = robot.points(true_joints[rows], sides[rows], planned.poses[rows])
    scatter = streams.of("scatter").standard_normal(points.shape)
    points += situation.size("scatter") * scatter
    turn = rotation(0.0, 0.0, streams.of("stand").uniform(-math.pi, math.pi))
    beams = (points - TRACKER_MM) @ turn.T
    covariance = stated_covariance_mm2(beams)
    beams += _stand_motion(situation, beams, streams)
    beams += sum(np.outer(s.is_on(count), s.shift_mm) for s in steps)
    noise = streams.of("noise").standard_normal((count, 3, 1))
    beams += (np.linalg.cholesky(covariance) @ noise)[..., 0]
    wrong = _spoil(beams, situation, planned, streams)
    readings = planned.joints.copy()
    wrong |= _unassemble(readings, nominal, situation, planned, streams)
    how: dict[str, Any] = {"approach": sides, "covariance_mm2": covariance}
    shots = Shots.of(readings, beams, nominal, sets=planned.sets, pairs=planned.pairs, **how)
    now = changed_robot(truth, [step for step in steps if step.end == count])
    return Measured(now, shots, frozenset(wrong), tuple(steps))


def stated_covariance_mm2(beams: Array) -> Array:
    """Return what a tracker states (N, 3, 3) of points (N, 3) in its frame, better along beams."""
    range_mm = np.linalg.norm(beams, axis=1)[:, None, None]
    along = (beams[:, :, None] * beams[:, None, :]) / range_mm**2
    across = (0.0075 + 3e-6 * range_mm) ** 2 * (np.eye(3) - along)
    return np.asarray(0.006**2 * along + across)


def _stand_motion(situation: Situation, beams: Array, streams: Streams) -> Array:
    """Return the slow motion (N, 3) of points seen from a stand that does not stand still."""
    time = np.linspace(0.0, 1.0, len(beams))[:, None]
    steps = streams.of("walk").standard_normal(beams.shape) / math.sqrt(len(beams))
    turned = np.cross(streams.direction("turn"), beams) / np.linalg.norm(TRACKER_MM)
    moved = situation.size("drift") * time * streams.direction("drift")
    moved = moved + situation.size("walk") * np.cumsum(steps, axis=0)
    moved = moved + situation.size("turn") * time * turned
    end = streams.direction("warm-up")
    return np.asarray(moved + situation.size("warm-up") * (1.0 - np.exp(-4.0 * time)) * end)


def _spoil(beams: Array, situation: Situation, planned: PlannedShots, streams: Streams) -> set[int]:
    """Put wrong shots beside where they are, and return their rows."""
    wrong: set[int] = set()
    for term in situation.of("wrong", "unseen"):
        rng, is_fitted = streams.of(term.effect), term.effect == "wrong"
        rows = planned.fitted if is_fitted else planned.rows("validation")
        count = max(planned.scaled(term.count), 1) if is_fitted else term.count
        spoiled = rng.choice(rows, count, replace=False)
        ways = directions(rng, len(spoiled))
        beams[spoiled] += term.size * (ways[:1] if term.how == "same" else ways)
        wrong.update(spoiled.tolist())
    return wrong


def _unassemble(
    readings: Array,
    nominal: RobotFile,
    situation: Situation,
    planned: PlannedShots,
    streams: Streams,
) -> set[int]:
    """Replace readings of some shots by some at which the nominal robot has no pose."""
    rng, low, high = streams.of("unassembled"), readings.min(axis=0), readings.max(axis=0)
    count = int(situation.size("unassembled"))
    rows = rng.choice(planned.fitted, count, replace=False)
    for row in rows.tolist():
        # twice as wide a range as the plan's has many such readings
        while nominal.kinematics.forward(readings[row : row + 1]).is_solved[0]:
            readings[row] = rng.uniform(1.5 * low - 0.5 * high, 1.5 * high - 0.5 * low)
    return set(rows.tolist())
