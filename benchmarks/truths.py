"""True robots of single rods, with what is wrong about them in a situation.

A situation is what is wrong beside a robot's geometry, in words: "clean", "rods 0.2 + drift 0.1",
"encoder 0.05 from 30 + wrong 10 x 1.5". `EFFECTS` lists what can be said, and in which unit. Counts
and places of shots are of 60 and grow with a campaign: in one of 120 "from 30" is from shot 60.

Theory of operation:

1. `draw_robot` draws the geometry (1 mm, 0.5°; of carriages 1 mm) and the errors of manufacture.
   Each effect has a random generator of its own, so that it is the same in every situation.
2. `TrueRobot.points` puts the reflector where the simulator's rods hold it: encoders, through
   gears, ripples and a bent arm, move the elbows; errors that no model has are added to the point.

What comes of it between shots and at the tracker is in `benchmarks.true_campaigns`.
"""

import math
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.robots.robot import RobotFile
from sim.geometry import PLATE_KINDS, PlateKind, geometry_of
from sim.robot.rods import Build, Plate, RodMechanism
from sim.robot.transmission import WEIGHTLESS, Load, Transmission

ROBOTS = {name: "par4-prototype" if name == "par4" else name for name in PLATE_KINDS}
"""Shipped robots by mechanism."""
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
WITHOUT_SIZE = ("clean", "small", "tolerances", "ripple")
"""Effects of which the usual size is meant where none is said."""
STEPS = ("encoder", "arm", "forearm", "mount", "stand")
"""Effects that begin between two shots."""
TERM = re.compile(
    r"(?P<effect>[a-z-]+)(?: (?P<count>\d+) x)?(?: (?P<size>\d+(?:\.\d+)?))?"
    r"(?: (?P<how>unstated|same|own|one))?"
    r"(?: from (?P<since>\d+)(?: to (?P<until>\d+))?| last (?P<last>\d+))?"
)
ROD_SPACING_MM, PITCH_MM, CRANK_MM = 80.0, 20.0, 350.0
SHOTS = 60
"""Number of identification shots that counts and places in a situation's words are of."""
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
        return float(sum(sizes) + sum(term.size for term in self.of(effect)))

    def of(self, *effects: str) -> list[Term]:
        """Return the terms of these effects."""
        return [term for term in self.terms if term.effect in effects]

    @property
    def is_reflector_stated(self) -> bool:
        """Whether the robot's file says where the reflector is: where a situation is about that."""
        terms = self.of("reflector")
        return bool(terms) and all(term.how != "unstated" for term in terms)

    def suits(self, mechanism: str) -> bool:
        """Whether a mechanism has the parts that the situation is about."""
        kind = PLATE_KINDS[mechanism]
        lacking = {"arm", "eccentricity"} if kind.on_rails else set()
        lacking |= {"theta"} if kind.turn is None else set()
        return not any(term.effect in lacking for term in self.terms)


def _parse_term(words: str) -> Term:
    match = TERM.fullmatch(words)
    if match is None or match["effect"] not in EFFECTS:
        raise ValueError(f"'{words}' is no effect; effects are {', '.join(EFFECTS)}")
    numbers = {key: int(match[key]) for key in ("count", "since", "until", "last") if match[key]}
    size = float(match["size"] or 1.0)
    missing = ""
    if match["effect"] in STEPS and not {"since", "last"} & numbers.keys():
        missing = "from which shot: add 'from 30' or 'last 5'"
    if match["effect"] not in WITHOUT_SIZE and not match["size"]:
        missing = f"its size, {EFFECTS[match['effect']]}"
    if match["effect"] in ("wrong", "unseen") and "count" not in numbers:
        missing = "how many shots, such as '3 x 1.5'"
    if missing:
        raise ValueError(f"'{words}' does not say {missing}")
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
        return np.asarray(directions(self.of(purpose), 1)[0])


def directions(rng: np.random.Generator, count: int) -> Array:
    """Draw unit vectors (count, 3)."""
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
        return float(np.hypot(self.poses[:, 0], self.poses[:, 1]).max())


def settled_points(
    rods: RodMechanism, joints: Array, near: Array, reflector_mm: Array, load: Load = WEIGHTLESS
) -> Array:
    """Return where rods put a reflector (N, 3) at joints, near poses (N, t), less its offset."""
    points = []
    for row, pose in zip(joints, near, strict=True):
        plate = rods.settle(row, Plate.level(rods.kind, pose[:3], float(pose[3:].sum())))[0]
        if load.at_plate_n:
            plate = rods.settle(row + load.yielding(rods, row, plate), plate)[0]
        points.append(rods.reflector_mm(plate, reflector_mm) - reflector_mm)
    return np.array(points)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrueRobot:
    """A robot as it was made, and what no model of it has."""

    kind: PlateKind
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
    """Motion of the drives under the plate's weight, at their cranks' ends."""
    reflector_mm: Array
    """Reflector on the plate, seen from the controlled point."""
    reflector_in_file_mm: Array
    """Where the robot's file has it."""
    frame_mm: Array
    """(2,): rise of the point by its squared reach and by its height."""
    lacks: tuple[Term, ...]
    """Errors of the point by its place."""
    reach_mm: float
    """Radius of the workspace, by which some of them grow."""
    dent_mm: Array
    """(3,): middle of a dent."""

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

    def known(self) -> dict[str, float]:
        """Return the values of the model's parameters by name, mm, deg and ppm."""
        rods_mm, gears, kind = self.build.rod_errors_mm, self.gears, self.kind
        columns = {
            "parallelogram_skew_deg": np.degrees((rods_mm[:, 1] - rods_mm[:, 0]) / ROD_SPACING_MM),
            "axis_tilt_deg": np.degrees(self.build.axis_tilts_rad),
            "bar_turn_deg": np.degrees(np.asarray(self.build.bar_turns_rad)),
            "encoder_gain_ppm": 1e6 * gears.ratio,
            "eccentricity_sin_deg": np.degrees(gears.eccentricity * np.cos(gears.phase_rad)),
            "eccentricity_cos_deg": -np.degrees(gears.eccentricity * np.sin(gears.phase_rad)),
            f"backlash_{kind.unit}": np.full(kind.arms, kind.outer(self.backlash)),
        }
        values = {f"arm{a}.{n}": float(v) for n, c in columns.items() for a, v in enumerate(c)}
        for arm, error_mm in enumerate(rods_mm.mean(axis=1)):
            values[f"arm{arm}.forearm_mm"] = self.flat[f"arm{arm}.forearm_mm"] + error_mm
        beyond_mm = (self.reflector_mm - self.reflector_in_file_mm).tolist()
        values |= {f"reflector_{axis}_mm": v for axis, v in zip("xyz", beyond_mm, strict=True)}
        by_reach, by_height = self.frame_mm.tolist()
        # a model's sag is of 400 mm of reach and of 200 mm of height
        return {**self.flat, **values, "sag_reach_mm": by_reach, "sag_z_mm": 0.5 * by_height}

    def _lack_mm(self, lack: Term, points: Array, turn_rad: Array) -> Array:
        """Return the errors (N, 3) of points by one thing that no model has."""
        radius = np.hypot(points[:, 0], points[:, 1]) / self.reach_mm
        if lack.effect == "cable":
            corner = points[:, :2].sum(axis=1) / math.sqrt(2.0) / self.reach_mm
            pull = lack.size * (np.maximum(corner - 0.3, 0.0) / 0.7) ** 2
            return np.outer(pull, [-0.6, -0.6, 0.53])
        away_mm = np.linalg.norm(points - self.dent_mm, axis=1)
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
    assert isinstance(nominal.mechanism, ClosedChain), "truths are robots of parallelograms"
    kind, plate = PLATE_KINDS[nominal.mechanism.name], nominal.mechanism.plate
    assert plate is not None, "every shipped robot's plate has places"
    arms, size = kind.arms, situation.size

    def normal(effect: str, *shape: int) -> Array:
        """Draw an effect's values with its size as σ."""
        return size(effect) * streams.of(effect).standard_normal(shape)

    flat = _geometry(nominal, kind, streams)
    for arm, error in enumerate(np.degrees(1e-3 * normal("azimuths", arms)).tolist()):
        flat[f"arm{arm}.{'elevation' if kind.on_rails else 'azimuth'}_deg"] += error
    joints_mm = np.array(plate.joints_mm) + size("plate") * directions(streams.of("plate"), arms)
    tilts_rad, bars_rad = 1e-3 * normal("tilts", arms), 1e-3 * normal("bars", arms)
    rods_mm = normal("rods", arms, 2)
    build = Build(joints_mm, ROD_SPACING_MM, rods_mm, tilts_rad, bar_turns_rad=bars_rad)
    # an eccentric scale exists on cranks alone; sine and cosine have the drawn sizes
    sine, cosine = np.radians(normal("eccentricity", 2, arms)) * (not kind.on_rails)
    ratio = 1e-6 * normal("ratios", arms)
    ratio[arm_of(streams, "ratio", arms)] += 1e-6 * size("ratio")
    none = np.zeros(arms)
    gears = Transmission(np.hypot(sine, cosine), np.arctan2(-cosine, sine), ratio, none, none)
    ripple, rates = _ripples(kind, situation, streams)
    return TrueRobot(
        kind=kind,
        flat=flat,
        build=build,
        gears=gears,
        backlash=math.radians(size("backlash") / 60.0) * kind.scales[0],
        ripple=ripple,
        rates=rates,
        phases=streams.of("phases").uniform(-math.pi, math.pi, arms),
        bend=_bend(kind, situation, planned, streams),
        yield_mm=size("yield"),
        reflector_mm=stated_reflector_mm(kind.name) + _misplaced(kind, situation, streams),
        reflector_in_file_mm=np.array(plate.reflector_mm),
        frame_mm=normal("frame", 2),
        lacks=tuple(situation.of("edge", "kink", "cable", "sag", "theta", "dent")),
        reach_mm=planned.reach_mm,
        dent_mm=streams.of("dent").choice(planned.poses[:, :3]),
    )


def _geometry(nominal: RobotFile, kind: PlateKind, streams: Streams) -> dict[str, float]:
    """Draw the contracted parameters about nominal."""
    rng, flat = streams.of("geometry"), {}
    for name in kind.names:
        # a pinion only scales the turn, and directions are effects of their own
        is_drawn = name.endswith("_mm") and name != "pinion_mm"
        spread = 0.5 if "offset_deg" in name else 1.0 if is_drawn else 0.0
        flat[name] = nominal.parameters[name] + spread * float(rng.standard_normal())
    return flat


def arm_of(streams: Streams, effect: str, arms: int) -> int:
    """Draw the arm that an effect is about."""
    return int(streams.of(f"arm of {effect}").integers(arms))


def stated_reflector_mm(name: str) -> Array:
    """Return the place of the reflector on the plate that a file of this robot states, (3,), mm."""
    # a reflector beside the axis of a part that turns would circle
    return np.array([0.0, 0.0, -45.0] if name.startswith("h4") else [20.0, -30.0, -45.0])


def _misplaced(kind: PlateKind, situation: Situation, streams: Streams) -> Array:
    """Return where a reflector is from where a file states it, (3,), mm."""
    # On a part that turns round the controlled point a reflector beside the axis would circle: it
    # is on the axis, as its file says.
    way = np.array([0.0, 0.0, -1.0]) if kind.turns_point else streams.direction("reflector")
    return situation.size("reflector") * way


def _ripples(kind: PlateKind, situation: Situation, streams: Streams) -> tuple[Array, Array]:
    """Return largest errors and rates of the ripples of each arm, (n,)."""
    arms, usual, rate = kind.arms, math.radians(0.5 / 60.0), 50.0
    if kind.on_rails:
        usual, rate = 0.03, 2.0 * math.pi / PITCH_MM
    ripple, rates = np.full(arms, situation.size("ripple") * usual), np.full(arms, rate)
    for term in situation.of("ripple"):
        if term.how == "one":
            ripple[np.arange(arms) != arm_of(streams, "ripple", arms)] = 0.0
        if term.how == "own":
            rates *= streams.of("rates").uniform(0.5, 2.0, arms)
    return ripple, rates


def _bend(kind: PlateKind, situation: Situation, planned: PlannedShots, streams: Streams) -> Array:
    """Return the bent arm, the joint from which it bends, and its rate."""
    arm = arm_of(streams, "bent", kind.arms)
    since, end = np.quantile(planned.joints[:, arm], [0.7, 1.0])
    size = math.radians(situation.size("bent")) * float(kind.scales[0])
    return np.array([arm, since, size / (end - since)])
