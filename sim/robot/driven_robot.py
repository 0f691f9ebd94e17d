"""The virtual robot as its drives move it: gears, repeatability, weight, parts that grow warm.

Theory of operation. Encoder readings come in; the reflector's true place comes out. On the way:

1. transmission: true joints by readings (eccentric scales, ratios, ripple: transmission.py);
2. play: the arm stays behind its gear by up to half the backlash, on the side it came from;
3. scatter of joints, drawn at each arrival from the stream of that target and attempt;
4. the rods place the plate (assembly.py, rods.py), with parts as long as their warmth makes them;
5. gears yield under the weights, and the plate is solved once more;
6. scatter of the position, drawn with that of the joints.

What is drawn or depends on the way (2, 3, 6) is decided on arrival and kept as the `Standing` until
the next one: a robot that stands does not jitter, and looking at it changes nothing. On the way the
robot can be seen too, with its play and without scatter.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from sim.errors import AssemblyLost
from sim.geometry import Array
from sim.random_streams import Attempts, WorkedTime
from sim.robot.assembly import Assembly, follow, restore
from sim.robot.rods import Growth, Mechanism, rotation
from sim.robot.section import Thermal
from sim.robot.transmission import WEIGHTLESS, Load, Transmission

SHORT_OF_THE_EDGE_RAD = math.radians(1.0)
"""Distance before a singularity at which friction holds the axes; above any noise of arrival.

Of carriages it is the travel that compares with it.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Behaviour:
    """Effects between the encoders and the mechanism."""

    backlash: Array
    """(n,): lost motion of each gear, from one side to the other, rad or mm."""
    joint_noise: float | Array
    """Standard deviation of each joint, (n,) or one for all, rad or mm, drawn at each arrival."""
    position_noise_mm: float
    """Half-width of a uniform draw on each coordinate of the plate, at each arrival."""
    thermal: Thermal
    transmission: Transmission
    load: Load = WEIGHTLESS


class SeenReflector(NamedTuple):
    """A reflector's centre and the direction that it faces, in the base frame.

    Also a reflector's mount: then both are relative to the controlled point, or to the joints of
    the half that carries the reflector, of a plate that is level and not turned.
    """

    point_mm: Array
    """(3,) mm"""
    facing: Array
    """(3,): unit vector."""
    half: int | None = None
    """Half of a platform of two parts that carries it; None: the controlled point's half."""


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """State in which the robot came to rest the last time."""

    encoders: Array
    """(n,) rad or mm"""
    play: Array
    """(n,): how far each joint is from its gear's middle, within the lost motion, rad or mm."""
    assembly: Assembly
    displaced_mm: Array
    """(3,): displacement of the plate that was drawn at this arrival."""


class DrivenRobot:
    """Robot from its encoders to the reflector in space."""

    def __init__(
        self,
        mechanism: Mechanism,
        behaviour: Behaviour,
        mount: SeenReflector,
        standing: Standing,
        *,
        worked: WorkedTime,
        arrivals: Attempts,
    ) -> None:
        self._mechanism = mechanism
        self._behaviour = behaviour
        self._mount = mount
        """The reflector as it is mounted now."""
        self._worked = worked
        self.arrivals = arrivals
        self.standing = standing
        self._ahead = standing.assembly
        """Assembly at the end of the path that was last tried, from which arriving goes on."""
        self._grown = lru_cache(maxsize=1)(behaviour.thermal.growth)
        self._last_view: tuple[Standing, Growth, Array, SeenReflector] | None = None
        """State in which the reflector was last seen, and the reflector as it was seen."""

    def passable_part(self, encoders: Array) -> float:
        """Return the part of the straight joint path, 0 to 1, that the mechanism follows freely."""
        try:
            self._ahead = self._follow_encoders(self.standing.assembly, encoders)
        except AssemblyLost as lost:
            # the robot stops short of the edge: at the singularity itself no assembly is solvable,
            # and the scatter of an arrival could carry it beyond
            self._ahead = self.standing.assembly
            change = np.abs(encoders - self.standing.encoders)
            length_rad = float((change / self._mechanism.kind.scales).max())
            return max(0.0, lost.part - SHORT_OF_THE_EDGE_RAD / length_rad)
        return 1.0

    def arrive(self, encoders: Array, target: tuple[int, ...]) -> None:
        """Come to rest at encoder readings; `target` names them for the draw of repeatability.

        Call `passable_part` first: raises `AssemblyLost` for readings beyond what it let through.
        """
        play = self._play_at(encoders)
        draw = self.arrivals.next_generator(target)
        jitter = self._behaviour.joint_noise * draw.standard_normal(len(encoders))
        limit_mm = self._behaviour.position_noise_mm
        displaced_mm = limit_mm * draw.uniform(-1.0, 1.0, 3)
        joints = self._behaviour.transmission.joints(encoders) + play + jitter
        assembly = self._move_and_yield(self._ahead, joints)
        self.standing = Standing(encoders, play, assembly, displaced_mm)
        self._ahead = assembly

    def carry_reflector(self, mount: SeenReflector) -> None:
        """Mount the reflector elsewhere on the platform."""
        self._mount = mount
        self._last_view = None

    def reflector(self, encoders: Array) -> SeenReflector:
        """Return the reflector at encoder readings: those at rest, or others of a motion."""
        # a tracker looks many times at a robot that stands: the last view is kept
        growth = self._growth()
        if self._last_view is not None:
            standing, grown, at, seen = self._last_view
            is_same = at is encoders or np.array_equal(at, encoders)
            if is_same and standing is self.standing and grown == growth:
                return seen
        seen = self._look(encoders)
        self._last_view = self.standing, growth, encoders, seen
        return seen

    def tool(self, encoders: Array) -> tuple[Array, Array]:
        """Return the controlled point (3,) and the axes (3, 3) of the tool, in the base frame."""
        assembly, displaced_mm = self._assembly(encoders)
        plate = assembly.plate
        axes = np.asarray(plate.rotation @ rotation(0.0, 0.0, plate.theta_rad))
        return np.asarray(plate.position_mm + displaced_mm), axes

    def _look(self, encoders: Array) -> SeenReflector:
        return self._locate_reflector(*self._assembly(encoders))

    def _assembly(self, encoders: Array) -> tuple[Assembly, Array]:
        """Return the assembly at encoder readings, and the plate's displacement (3,) there."""
        standing = self.standing
        if np.array_equal(encoders, standing.encoders):
            # solved again, since parts may have grown while the robot stood; the joints stay
            at_rest = standing.assembly
            now = restore(self._mechanism, at_rest.joints, at_rest.plate, self._growth())
            return now, standing.displaced_mm
        return self._follow_encoders(standing.assembly, encoders), np.zeros(3)

    def _follow_encoders(self, start: Assembly, encoders: Array) -> Assembly:
        joints = self._behaviour.transmission.joints(encoders)
        return self._move_and_yield(start, joints + self._play_at(encoders))

    def _move_and_yield(self, start: Assembly, joints: Array) -> Assembly:
        """Return the assembly after a path to joints, which then yield under the weights."""
        # The torques are those of the rigid pose: yielding by arc minutes hardly changes them,
        # so one correction is enough.
        rigid, load = follow(self._mechanism, start, joints, self._growth()), self._behaviour.load
        if np.isinf(load.stiffness).all():
            return rigid
        yielded = joints + load.yielding(self._mechanism, joints, rigid.plate)
        return restore(self._mechanism, yielded, rigid.plate, self._growth())

    def _play_at(self, encoders: Array) -> Array:
        """Return each joint's play (n,) at encoder readings, by the way from the last standing."""
        # Play operator: while the gear moves inside its lost motion the arm stays where it is, so
        # the play changes by minus the gear's motion; at ± half the backlash a flank touches and
        # takes the arm along. A path is straight, so its end alone decides.
        standing, half = self.standing, 0.5 * self._behaviour.backlash
        if_arm_stays = standing.play - (encoders - standing.encoders)
        return np.clip(if_arm_stays, -half, half)

    def _growth(self) -> Growth:
        return self._grown(self._worked.seconds)

    def _locate_reflector(self, assembly: Assembly, displaced_mm: Array) -> SeenReflector:
        rotation, mount = assembly.plate.rotation, self._mount
        point_mm = self._mechanism.reflector_mm(assembly.plate, mount.point_mm, mount.half)
        return SeenReflector(point_mm + displaced_mm, rotation @ mount.facing)
