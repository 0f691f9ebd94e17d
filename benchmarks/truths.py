"""Draw robots of single rods in a situation, and measure campaigns of them by a tracker.

A situation is what is wrong beside a robot's geometry, in words: "clean", "rods 0.2 + drift 0.1",
"encoder 0.05 from 30 + wrong 10 x 1.5". `EFFECTS` lists what can be said, and in which unit. Counts
of shots are of 60 and grow with the campaign: in one of 120 shots "from 30" is from shot 60.

Theory of operation:

1. `draw_robot` draws the geometry (1 mm, 0.5°; of carriages 1 mm) and the errors of manufacture.
   Each effect has a random generator of its own, so that it is the same in every situation.
2. `TrueRobot.points` puts the reflector where the simulator's rods hold it: encoders, through
   gears, ripples and bent arms, move the elbows; errors that no model has are added to the point.
3. `measure` measures a plan: it changes the robot or its stand between shots, lets the stand drift,
   adds the tracker's noise as it is stated, and spoils the wrong shots.
"""

import math
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.false_acceptance import (
    CRANK_MM,
    PITCH_MM,
    ROD_SPACING_MM,
    TRACKER_MM,
    noise_mm,
    settled_points,
    stated_covariance_mm2,
)
from campaigns.arrays import Array, Index
from campaigns.robots.robot import RobotFile
from pkmcal import Shots
from sim.geometry import KINDS, LENGTHS, Kind, geometry_of
from sim.robot.rods import Build, RodMechanism, rotation
from sim.robot.transmission import Load, Transmission

EFFECTS = {
    "clean": "nothing but geometry",
    "small": "all errors of manufacture, small",
    "tolerances": "all errors of manufacture, of the size of the product's tolerances",
    "azimuths": "mrad, directions of arms or rails",
    "rods": "mm, each rod of a forearm",
    "tilts": "mrad, motor axes or rails with their bars",
    "bars": "mrad, the plate's bars",
    "eccentricity": "deg, eccentric encoders of cranks",
    "ratios": "ppm, gears or screws of all arms",
    "ratio": "ppm, of one arm",
    "backlash": "arc minutes",
    "yield": "mm, drives under the plate's weight",
    "frame": "mm, a frame that sags by reach",
    "scatter": "mm, of the point, an axis",
    "reflector": "mm from where the file has it; `unstated`: by a file that does not say",
    "plate": "mm, each joint on the plate by itself",
    "wrong": "COUNT x mm, wrong shots; `same`: all in one direction",
    "unseen": "COUNT x mm, wrong hold-out shots",
    "unassembled": "shots with readings at which the nominal robot cannot be assembled",
    "encoder": "deg (of carriages 6 mm a degree), a step of one arm's encoder",
    "arm": "mm, a step of one crank's length",
    "forearm": "mm, a step of one forearm's length",
    "mount": "mm, a step of one motor or rail",
    "stand": "mm, a step of the tracker's stand",
    "drift": "mm, steady motion of the stand",
    "walk": "mm, random walk of the stand",
    "turn": "mm at the robot, a stand that turns",
    "warm-up": "mm, motion of the stand that comes to an end",
    "ripple": "times 0.5 arc minutes or 0.03 mm of unknown period; `own`, a rate an arm; `one` arm",
    "edge": "mm, z at the edge by the tenth power of the radius",
    "kink": "mrad, z beyond 0.4 of the reach",
    "cable": "mm, a pull in one corner",
    "sag": "mm, z beyond 0.6 of the reach",
    "theta": "mm/rad, z beyond a turn of 0.3 rad",
    "dent": "0.5 mm, z around one place, σ in mm",
    "bent": "deg, one arm beyond the lower 0.7 of its joint's range",
    "lag": "% of the way from the shot before that is missing",
}
"""Effects by their words: the unit of the size, and what it is the size of."""
SMALL = {
    "azimuths": 0.3, "rods": 0.05, "tilts": 0.3, "bars": 0.2, "eccentricity": 0.007,
    "ratios": 100.0, "backlash": 0.2, "frame": 0.01,
}  # fmt: skip
TOLERANCES = {
    "azimuths": 2.0, "rods": 0.115, "tilts": 1.5, "bars": 1.0, "eccentricity": 0.03,
    "ratios": 500.0, "backlash": 1.0, "yield": 0.1, "frame": 0.05,
}  # fmt: skip
"""Sizes (1 σ) of the errors of manufacture, in the units of `EFFECTS`."""
STEPS = ("encoder", "arm", "forearm", "mount", "stand")
"""Effects that begin between two shots."""
TERM = re.compile(
    r"(?P<effect>[a-z-]+)(?: (?P<count>\d+) x)?(?: (?P<size>\d+(?:\.\d+)?))?"
    r"(?: (?P<how>unstated|same|own|one))?"
    r"(?: from (?P<since>\d+)(?: to (?P<until>\d+))?| last (?P<last>\d+))?"
)
SHOTS = 60
"""Number of identification shots that counts and places in a situation's words are of."""
MM_PER_DEG = 6.0
"""Travel of a carriage that compares with 1° of a crank."""
RIPPLE_RAD, RIPPLE_RATE, RIPPLE_MM = math.radians(0.5 / 60.0), 50.0, 0.03
SAG_REACH_MM = 400.0


@dataclass(frozen=True, slots=True)
class Term:
    """One effect of a situation, its size, and how and when it comes."""

    effect: str
    size: float = 1.0
    count: int = 0
    how: str = ""
    since: int | None = None
    """Identification shot from which it lasts, of 60."""
    until: int | None = None
    """Last identification shot at which it lasts; None: to the end."""
    last: int | None = None
    """Number of shots of any set, counted as they are, at whose first it begins."""


@dataclass(frozen=True, slots=True)
class Situation:
    """What is wrong with a robot beside its geometry, and with its campaign."""

    name: str
    terms: tuple[Term, ...]

    @classmethod
    def parse(cls, name: str) -> "Situation":
        """Read a situation's words; raise `ValueError` for those that mean nothing."""
        return cls(name, tuple(_parse_term(words) for words in name.split(" + ")))

    def size(self, effect: str) -> float:
        """Return the size of an error of manufacture, 0 if there is none."""
        drawn = {"small": SMALL, "tolerances": TOLERANCES}
        sizes = [drawn[t.effect].get(effect, 0.0) for t in self.terms if t.effect in drawn]
        return sum(sizes) + sum(term.size for term in self.of(effect))

    def of(self, *effects: str) -> list[Term]:
        """Return the terms of these effects."""
        return [term for term in self.terms if term.effect in effects]

    @property
    def is_reflector_stated(self) -> bool:
        """Whether the robot's file says where the reflector is."""
        return all(term.how != "unstated" for term in self.of("reflector"))

    def suits(self, mechanism: str) -> bool:
        """Whether a mechanism has the parts that the situation is about."""
        kind = KINDS[mechanism]
        lacking = {"arm", "eccentricity"} if kind.on_rails else set()
        lacking |= {"theta"} if kind.turn is None else set()
        return not any(term.effect in lacking for term in self.terms)


def _parse_term(words: str) -> Term:
    match = TERM.fullmatch(words)
    if match is None or match["effect"] not in EFFECTS:
        raise ValueError(f"'{words}' is no effect; effects are {', '.join(EFFECTS)}")
    numbers = {key: int(match[key]) for key in ("count", "since", "until", "last") if match[key]}
    size = float(match["size"] or 1.0)
    if match["effect"] in STEPS and not {"since", "last"} & numbers.keys():
        raise ValueError(f"'{words}' does not say from which shot: add 'from 30' or 'last 5'")
    return Term(match["effect"], size, how=match["how"] or "", **numbers)


@dataclass(frozen=True, slots=True)
class Streams:
    """Random generators by purpose: no effect changes what another one draws."""

    key: tuple[int, ...]

    def of(self, purpose: str) -> np.random.Generator:
        """Return a new generator; the same purpose always draws the same numbers."""
        return np.random.default_rng([*self.key, zlib.crc32(purpose.encode())])

    def direction(self, purpose: str) -> Array:
        """Return a random unit vector (3,)."""
        return _directions(self.of(purpose), 1)[0]


def _directions(rng: np.random.Generator, count: int) -> Array:
    drawn = rng.standard_normal((count, 3))
    return np.asarray(drawn / np.linalg.norm(drawn, axis=1, keepdims=True))


@dataclass(frozen=True, slots=True, eq=False)
class PlannedShots:
    """Shots of a plan in measuring order: joints (N, n), poses (N, t), sets and pairs."""

    joints: Array
    poses: Array
    sets: tuple[str, ...]
    pairs: tuple[int | None, ...]
    counted_of: int = SHOTS
    """Number of fitted shots that a situation's counts and places are of."""

    def rows(self, *purposes: str) -> Index:
        """Return the rows of some sets."""
        return np.flatnonzero(np.isin(np.array(self.sets), purposes))

    @property
    def fitted(self) -> Index:
        """Rows of the shots that a fit uses."""
        return self.rows("identification", "check")

    def scaled(self, count: int) -> int:
        """Return as many of these shots as a situation's count means."""
        return count * len(self.fitted) // self.counted_of

    @property
    def reach_mm(self) -> float:
        """Largest distance of a pose from the base's z axis."""
        return float(np.hypot(*self.poses[:, :2].T).max())


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrueRobot:
    """A robot as it was made, and what no model of it has."""

    kind: Kind
    flat: Mapping[str, float]
    """Contracted parameters by name, mm and deg."""
    build: Build
    gears: Transmission
    backlash: float
    """Lost motion of each joint, rad or mm."""
    ripple: Array
    """Largest error of each joint (n,) in each period, rad or mm."""
    rates: Array
    """Radians of the ripples for a radian or mm of each joint, (n,)."""
    phases: Array
    bend: Array
    """(3,): bent arm's joint, the angle from which it bends, and its error a rad or mm beyond."""
    yield_mm: float
    reflector_mm: Array
    """Reflector on the plate, seen from the controlled point."""
    lacks: tuple[Term, ...]
    """Errors of the point that depend on its place."""
    frame_mm: Array
    """(2,): rise of the point by its squared reach and by its height."""
    reach_mm: float
    middle_mm: Array
    """(3,): place of a dent."""

    def points(self, joints: Array, sides: Array, near: Array) -> Array:
        """Return the reflector's points (N, 3) at encoder values, less its offset, near poses."""
        rods = RodMechanism(geometry_of(self.flat, self.kind), self.build)
        moved = self.gears.joints(joints) - 0.5 * self.backlash * sides
        moved += self.ripple * np.sin(self.rates * joints + self.phases)
        arm, since, rate = self.bend
        moved[:, int(arm)] += rate * np.maximum(joints[:, int(arm)] - since, 0.0)
        load = Load(0.0, self.yield_mm, 1.0 if self.kind.on_rails else CRANK_MM**2)
        points = settled_points(rods, moved, near, self.reflector_mm, load)
        by_reach = (points[:, :2] ** 2).sum(axis=1) / SAG_REACH_MM**2
        points[:, 2] += self.frame_mm @ [by_reach, points[:, 2] / SAG_REACH_MM]
        turn_rad = near[:, 3:].sum(axis=1)
        errors_mm = [self._lack_mm(lack, points, turn_rad) for lack in self.lacks]
        return np.asarray(points + sum(errors_mm))

    def _lack_mm(self, lack: Term, points: Array, turn_rad: Array) -> Array:
        """Return the errors (N, 3) of points by one thing that no model has."""
        radius = np.hypot(points[:, 0], points[:, 1]) / self.reach_mm
        if lack.effect == "cable":
            corner = points[:, :2].sum(axis=1) / math.sqrt(2.0) / self.reach_mm
            pull = lack.size * (np.maximum(corner - 0.3, 0.0) / 0.7) ** 2
            return np.outer(pull, [-0.6, -0.6, 0.53])
        away_mm = np.linalg.norm(points - self.middle_mm, axis=1)
        rise = {
            "edge": lack.size * radius**10,
            "kink": 1e-3 * lack.size * np.maximum(points[:, 0] - 0.4 * self.reach_mm, 0.0),
            "sag": -lack.size * np.maximum(radius - 0.6, 0.0) / 0.4,
            "theta": lack.size * np.maximum(turn_rad - 0.3, 0.0),
            "dent": 0.5 * np.exp(-0.5 * (away_mm / lack.size) ** 2),
        }[lack.effect]
        return np.outer(rise, [0.0, 0.0, 1.0])


def draw_robot(
    nominal: RobotFile, situation: Situation, planned: PlannedShots, streams: Streams
) -> TrueRobot:
    """Draw a robot with errors of geometry and those of a situation."""
    kind, plate = KINDS[nominal.mechanism.name], nominal.mechanism.plate
    assert plate is not None, "every shipped robot's plate has places"
    arms, size = kind.arms, situation.size

    def normal(effect: str, *shape: int) -> Array:
        """Draw an effect's values with its size as σ."""
        return size(effect) * streams.of(effect).standard_normal(shape)

    flat = _geometry(nominal, kind, streams)
    for arm, error in enumerate(np.degrees(1e-3 * normal("azimuths", arms)).tolist()):
        flat[f"arm{arm}.{'elevation' if kind.on_rails else 'azimuth'}_deg"] += error
    joints_mm = np.array(plate.joints_mm) + size("plate") * _directions(streams.of("plate"), arms)
    tilts_rad, bars_rad = 1e-3 * normal("tilts", arms), 1e-3 * normal("bars", arms)
    rods_mm = normal("rods", arms, 2)
    build = Build(joints_mm, ROD_SPACING_MM, rods_mm, tilts_rad, bar_turns_rad=bars_rad)
    # an eccentric scale exists on cranks alone; sine and cosine have the drawn sizes
    sine, cosine = np.radians(normal("eccentricity", 2, arms)) * (not kind.on_rails)
    ratio = 1e-6 * normal("ratios", arms)
    ratio[_arm(streams, "ratio", arms)] += 1e-6 * size("ratio")
    none = np.zeros(arms)
    gears = Transmission(np.hypot(sine, cosine), np.arctan2(-cosine, sine), ratio, none, none)
    ripple, rates = _ripples(kind, situation, streams)
    return TrueRobot(
        kind=kind,
        flat=flat,
        build=build,
        gears=gears,
        backlash=math.radians(size("backlash") / 60.0) * kind.scale,
        ripple=ripple,
        rates=rates,
        phases=streams.of("phases").uniform(-math.pi, math.pi, arms),
        bend=_bend(kind, situation, planned, streams),
        yield_mm=size("yield"),
        reflector_mm=np.array(plate.reflector_mm) + _misplaced(kind, situation, streams),
        lacks=tuple(situation.of("edge", "kink", "cable", "sag", "theta", "dent")),
        frame_mm=normal("frame", 2),
        reach_mm=planned.reach_mm,
        middle_mm=streams.of("dent").choice(planned.poses[:, :3]),
    )


def _geometry(nominal: RobotFile, kind: Kind, streams: Streams) -> dict[str, float]:
    """Draw the contracted parameters about nominal."""
    rng, flat = streams.of("geometry"), {}
    for name in kind.names:
        # a pinion only scales the turn, and directions are effects of their own
        is_drawn = name.endswith("_mm") and name != "pinion_mm"
        spread = 0.5 if "offset_deg" in name else 1.0 if is_drawn else 0.0
        flat[name] = nominal.parameters[name] + spread * float(rng.standard_normal())
    return flat


def _arm(streams: Streams, effect: str, arms: int) -> int:
    """Draw the arm that an effect is about."""
    return int(streams.of(f"arm of {effect}").integers(arms))


def _misplaced(kind: Kind, situation: Situation, streams: Streams) -> Array:
    """Return where a reflector is from where its file has it, (3,), mm."""
    # On a part that turns round the controlled point a reflector beside the axis would circle: it
    # is on the axis, as its file says.
    way = np.array([0.0, 0.0, -1.0]) if kind.turns_point else streams.direction("reflector")
    return situation.size("reflector") * way


def _ripples(kind: Kind, situation: Situation, streams: Streams) -> tuple[Array, Array]:
    """Return largest errors and rates of the ripples of each arm, (n,)."""
    arms = kind.arms
    one, rate = (RIPPLE_MM, 2.0 * math.pi / PITCH_MM) if kind.on_rails else (RIPPLE_RAD, RIPPLE_RATE)
    ripple, rates = np.full(arms, situation.size("ripple") * one), np.full(arms, rate)
    for term in situation.of("ripple"):
        if term.how == "one":
            ripple[np.arange(arms) != _arm(streams, "ripple", arms)] = 0.0
        if term.how == "own":
            rates *= streams.of("rates").uniform(0.5, 2.0, arms)
    return ripple, rates


def _bend(kind: Kind, situation: Situation, planned: PlannedShots, streams: Streams) -> Array:
    """Return the bent arm, the joint from which it bends, and its rate."""
    arm = _arm(streams, "bent", kind.arms)
    since, end = np.quantile(planned.joints[:, arm], [0.7, 1.0])
    size = math.radians(situation.size("bent")) * kind.scale
    return np.array([arm, since, size / (end - since)])


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


def resolve_step(term: Term, kind: Kind, planned: PlannedShots, streams: Streams) -> TrueStep:
    """Return what a step changes in a plan's campaign."""
    fitted, count = planned.fitted, len(planned.joints)
    first = count - term.last if term.last else int(fitted[planned.scaled(term.since or 0)])
    end = count if term.until is None else int(fitted[planned.scaled(term.until)]) + 1
    way = term.size * streams.direction(f"way of {term.effect}")
    if term.effect == "stand":
        return TrueStep("frame", first, end, term.size, {}, way)
    arm, size = _arm(streams, term.effect, kind.arms), term.size
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
    for name, (_, field) in truth.kind.parameters.items():
        spread = 0.01 if field.stem in ("x", "y", "z") else 0.005 if field.stem in LENGTHS else 0.0
        if field.stem == "joint_offset":
            spread = 0.002 if field.unit == "deg" else 0.01
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
    beams += noise_mm(covariance, streams.of("noise"))
    wrong = _spoil(beams, situation, planned, streams)
    readings = planned.joints.copy()
    wrong |= _unassemble(readings, nominal, situation, planned, streams)
    how: dict[str, Any] = {"approach": sides, "covariance_mm2": covariance}
    shots = Shots.of(readings, beams, nominal, sets=planned.sets, pairs=planned.pairs, **how)
    now = changed_robot(truth, [step for step in steps if step.end == count])
    return Measured(now, shots, frozenset(wrong), tuple(steps))


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


def _spoil(
    beams: Array, situation: Situation, planned: PlannedShots, streams: Streams
) -> set[int]:
    """Put wrong shots beside where they are, and return their rows."""
    wrong: set[int] = set()
    for term in situation.of("wrong", "unseen"):
        rng, is_fitted = streams.of(term.effect), term.effect == "wrong"
        rows = planned.fitted if is_fitted else planned.rows("validation")
        count = max(planned.scaled(term.count), 1) if is_fitted else term.count
        spoiled = rng.choice(rows, count, replace=False)
        ways = _directions(rng, len(spoiled))
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
