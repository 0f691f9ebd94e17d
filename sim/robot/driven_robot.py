"""The virtual robot as its drives move it: gears, repeatability, weight, parts that grow warm."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from sim.errors import AssemblyLost
from sim.geometry import Array
from sim.random_streams import Attempts, Purpose, WorkedTime, generator
from sim.robot.assembly import Assembly, follow, restore
from sim.robot.rods import Growth, RodMechanism
from sim.robot.section import Thermal
from sim.robot.transmission import WEIGHTLESS, Load, Transmission

SHORT_OF_THE_EDGE_RAD = math.radians(1.0)
"""Distance before a singularity where friction holds the axes; above any noise of arrival.

Of carriages the travel that compares with it.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Behaviour:
    """Effects between the encoders and the mechanism."""

    backlash: Array
    """(n,): lost motion of each gear, from one side to the other, rad or mm."""
    joint_noise: float
    """Standard deviation of each joint, rad or mm, drawn at each arrival."""
    position_noise_mm: float
    """Half-width of a uniform draw on each coordinate of the plate, at each arrival."""
    thermal: Thermal
    transmission: Transmission
    load: Load = WEIGHTLESS


class SeenReflector(NamedTuple):
    """A reflector's centre, and where it looks.

    In the base frame; of one's mount from the controlled point, or from the joints of the half that
    carries it, as long as the plate is level and not turned.
    """

    point_mm: Array
    """(3,)"""
    facing: Array
    """(3,): unit vector."""
    half: int | None = None
    """Of a platform of two parts, where it is not the controlled point's."""


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """State in which the robot came to rest the last time."""

    encoders: Array
    """(n,) rad or mm"""
    play: Array
    """(n,): each joint less its encoder's reading, left by the gear's lost motion."""
    assembly: Assembly
    displaced_mm: Array
    """(3,): what repeatability moved the plate by."""


class DrivenRobot:
    """Robot from its encoders to the reflector in space."""

    def __init__(
        self,
        rods: RodMechanism,
        behaviour: Behaviour,
        mount: SeenReflector,
        standing: Standing,
        *,
        seed: int,
        worked: WorkedTime,
        arrivals: Attempts,
    ) -> None:
        self._rods = rods
        self._behaviour = behaviour
        self._mount = mount
        self._seed = seed
        self._worked = worked
        self.arrivals = arrivals
        self.standing = standing
        self._ahead = standing.assembly
        self._grown = lru_cache(maxsize=1)(behaviour.thermal.growth)
        self._last_view: tuple[Standing, Growth, Array, SeenReflector] | None = None
        """Reflector as it was seen the last time, after the state that it was seen in."""

    def passable_part(self, encoders: Array) -> float:
        """Return the part of the straight joint path, 0 to 1, that the mechanism follows freely."""
        try:
            self._ahead = self._followed(self.standing.assembly, encoders)
        except AssemblyLost as lost:
            self._ahead = self.standing.assembly
            length_rad = (
                float(np.abs(encoders - self.standing.encoders).max()) / self._rods.kind.scale
            )
            return max(0.0, lost.part - SHORT_OF_THE_EDGE_RAD / length_rad)
        return 1.0

    def arrive(self, encoders: Array, target: tuple[int, ...]) -> None:
        """Come to rest there; `target` names it for the draw of repeatability.

        Raises `AssemblyLost` for a place that `passable_part` has not let through.
        """
        play = self._play(encoders)
        attempt = self.arrivals.next(target)
        draw = generator(self._seed, Purpose.ARRIVAL, *target, attempt)
        jitter = self._behaviour.joint_noise * draw.standard_normal(len(encoders))
        limit_mm = self._behaviour.position_noise_mm
        displaced_mm = limit_mm * draw.uniform(-1.0, 1.0, 3)
        joints = self._behaviour.transmission.joints(encoders) + play + jitter
        assembly = self._moved(self._ahead, joints)
        self.standing = Standing(encoders, play, assembly, displaced_mm)
        self._ahead = assembly

    def reflector(self, encoders: Array) -> SeenReflector:
        """Return the reflector at rest, or at these encoders on the way to somewhere.

        A tracker looks many times at a robot that stands: the last view is kept.
        """
        growth = self._growth()
        if self._last_view is not None:
            standing, grown, at, seen = self._last_view
            same = at is encoders or np.array_equal(at, encoders)
            if same and standing is self.standing and grown == growth:
                return seen
        seen = self._view(encoders)
        self._last_view = self.standing, growth, encoders, seen
        return seen

    def _view(self, encoders: Array) -> SeenReflector:
        standing = self.standing
        if np.array_equal(encoders, standing.encoders):
            at_rest = standing.assembly
            now = restore(self._rods, at_rest.joints, at_rest.plate, self._growth())
            return self._seen(now, standing.displaced_mm)
        return self._seen(self._followed(standing.assembly, encoders), np.zeros(3))

    def _followed(self, start: Assembly, encoders: Array) -> Assembly:
        joints = self._behaviour.transmission.joints(encoders)
        return self._moved(start, joints + self._play(encoders))

    def _moved(self, start: Assembly, joints: Array) -> Assembly:
        """Return the assembly with these joints beyond the gears, which yield under the weight."""
        there, load = follow(self._rods, start, joints, self._growth()), self._behaviour.load
        if math.isinf(load.stiffness):
            return there
        given = joints + load.yielding(self._rods, joints, there.plate)
        return restore(self._rods, given, there.plate, self._growth())

    def _play(self, encoders: Array) -> Array:
        """Return the lost motion: the arm stays behind until the tooth touches the other flank."""
        standing, half = self.standing, 0.5 * self._behaviour.backlash
        left_behind = standing.play - (encoders - standing.encoders)
        return np.clip(left_behind, -half, half)

    def _growth(self) -> Growth:
        return self._grown(self._worked.seconds)

    def _seen(self, assembly: Assembly, displaced_mm: Array) -> SeenReflector:
        rotation, mount = assembly.plate.rotation, self._mount
        point_mm = self._rods.reflector_mm(assembly.plate, mount.point_mm, mount.half)
        return SeenReflector(point_mm + displaced_mm, rotation @ mount.facing)
