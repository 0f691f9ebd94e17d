"""The mechanism's rods, bars and platform, of whatever kind: six or eight rods hold it.

First, rotations by three angles about fixed axes, with their derivatives.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from sim.errors import AssemblyLost
from sim.geometry import UP, Array, Geometry, Kind


def _about(axis: int, angle_rad: float) -> tuple[Array, Array]:
    """Return the rotation about one axis and its derivative."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    both = np.zeros((2, 3, 3))
    turn, rate = both
    turn[axis, axis] = 1.0
    turn[first, first] = turn[second, second] = cosine
    turn[first, second], turn[second, first] = -sine, sine
    rate[first, first] = rate[second, second] = -sine
    rate[first, second], rate[second, first] = -cosine, cosine
    return turn, rate


def rotation(about_x: float, about_y: float, about_z: float) -> Array:
    """Return (3, 3): turned about x, then y, then z of the fixed frame, rad."""
    return np.asarray(_about(2, about_z)[0] @ _about(1, about_y)[0] @ _about(0, about_x)[0])


def rotation_and_rates(about_x: float, about_y: float, about_z: float) -> tuple[Array, Array]:
    """Return the rotation (3, 3) and its derivatives (3, 3, 3) by the three angles."""
    (x, dx), (y, dy), (z, dz) = _about(0, about_x), _about(1, about_y), _about(2, about_z)
    zy, rates = z @ y, np.empty((3, 3, 3))
    for rate, one, other in zip(rates, (zy, z @ dy, dz @ y), (dx, x, x), strict=True):
        np.matmul(one, other, out=rate)
    return zy @ x, rates


RADIAN_AS_MM = 100.0
"""Length by which a step in angle is compared with one in position."""
SETTLED_MM = 1e-9
"""A step this small leaves an error at the rounding of the figures: convergence is fast."""
ITERATIONS = 25


class Growth(NamedTuple):
    """Relative growth of a robot's parts since they were cold."""

    arms: float = 0.0
    """Of cranks, or of the scales of rails."""
    forearms: float = 0.0
    """Of rods."""
    frame: float = 0.0
    """Of the ways from the base frame's origin to motors or rails."""


COLD = Growth()


@dataclass(frozen=True, slots=True, eq=False)
class Build:
    """Departures of the mechanism from its contracted model, in sizes and in errors."""

    plate_joints_mm: Array
    """(n, 3): b_i, where the bars sit on the plate as seen from B'_i."""
    rod_spacing_mm: float
    rod_errors_mm: Array
    """(n, 2): each rod's length less its forearm's."""
    axis_tilts_rad: Array
    """(n,): motor axes out of the horizontal, or rails and the bars on them leaning aside.

    They are turned about the arm's direction outward.
    """
    leans_rad: Array | None = None
    """(n,): rails leaning outward, turned about the bars."""
    bar_turns_rad: Array | None = None
    """(n,): bars on the plate, turned about z."""


@dataclass(frozen=True, slots=True, eq=False)
class Plate:
    """Place of the platform: controlled point, orientation, and its inner joint's turn."""

    unknowns: Array
    """(6,) or (7,): x, y, z mm; rotations about x, y, z in rad, applied in that order; θ rad."""

    @classmethod
    def level(cls, kind: Kind, position_mm: Array, theta_rad: float) -> Self:
        """Return a platform that is not tilted."""
        return cls(np.array([*position_mm, 0.0, 0.0, 0.0, theta_rad])[: kind.unknowns])

    @property
    def position_mm(self) -> Array:
        """(3,): the controlled point in the base frame."""
        return self.unknowns[:3]

    @property
    def rotation(self) -> Array:
        """(3, 3): base_from_plate, of every part that an arm's rods hold."""
        return rotation(*self.unknowns[3:6])

    @property
    def theta_rad(self) -> float:
        """Turn of the inner joint; 0 of a platform without one."""
        return float(self.unknowns[6:].sum())


class RodMechanism:
    """The mechanism's parts and their closure. Holds no state: joints in, plate out."""

    def __init__(self, truth: Geometry, build: Build) -> None:
        self.kind = truth.kind
        self._truth = truth
        self._outward = truth.outward
        outward, sideways = truth.outward, truth.sideways
        half_bar_mm = 0.5 * build.rod_spacing_mm
        self._motors_mm = truth.motors_mm + build.plate_joints_mm
        tilts, leans = build.axis_tilts_rad, build.leans_rad
        self._down = turned(np.tile(-UP, (self.kind.arms, 1)), outward, tilts)
        leaning = truth.rails if leans is None else turned(truth.rails, sideways, leans)
        self._rails = turned(leaning, outward, tilts)
        self._elbow_bar_mm = half_bar_mm * turned(sideways, outward, tilts)
        bars, turns = sideways, build.bar_turns_rad
        if turns is not None:
            bars = turned(bars, np.tile(UP, (self.kind.arms, 1)), turns)
        self._anchors_mm = _pairs(build.plate_joints_mm, half_bar_mm * bars)
        self._rods_mm = (truth.forearms_mm[:, None] + build.rod_errors_mm).ravel()

    def elbows_mm(self, joints: Array, growth: Growth = COLD) -> Array:
        """Return (2n, 3): the rods' upper ends in the base frame."""
        places = (joints + self._truth.joint_offsets)[:, None]
        motors_mm = (1.0 + growth.frame) * self._motors_mm
        if self.kind.on_rails:
            ways_mm = (1.0 + growth.arms) * places * self._rails
            return _pairs(motors_mm + ways_mm, self._elbow_bar_mm)
        cranks = np.cos(places) * self._outward + np.sin(places) * self._down
        lengths_mm = (self._truth.arms_mm * (1.0 + growth.arms))[:, None]
        return _pairs(motors_mm + lengths_mm * cranks, self._elbow_bar_mm)

    def misfit(
        self, elbows_mm: Array, unknowns: Array, growth: Growth = COLD
    ) -> tuple[Array, Array]:
        """Return the gaps less the rods' lengths, (2n,) mm, and the derivative (2n, u)."""
        turn, rates = rotation_and_rates(*unknowns[3:6])
        apart_mm, apart_rate_mm = self._truth.plate_joints_apart(float(unknowns[6:].sum()))
        on_plate_mm = self._anchors_mm + np.repeat(apart_mm, 2, axis=0)
        gaps_mm = unknowns[:3] + on_plate_mm @ turn.T - elbows_mm
        lengths_mm = np.sqrt(np.einsum("ij,ij->i", gaps_mm, gaps_mm))
        along = gaps_mm / lengths_mm[:, None]
        jacobian = np.empty((len(gaps_mm), len(unknowns)))
        jacobian[:, :3] = along
        jacobian[:, 3:6] = np.einsum("ri,kij,rj->rk", along, rates, on_plate_mm)
        if self.kind.turn is not None:
            moved = np.repeat(apart_rate_mm, 2, axis=0) @ turn.T
            jacobian[:, 6] = np.einsum("ri,ri->r", along, moved)
        return lengths_mm - (1.0 + growth.forearms) * self._rods_mm, jacobian

    def reflector_mm(self, plate: Plate, offset_mm: Array, half: int | None = None) -> Array:
        """Return the place (3,) of a reflector at an offset from the controlled point, on its part.

        A part that turns takes the offset with it: only along its axis does an offset stay.
        """
        if half is not None:
            arm = 0 if half == 1 else -1
            offset_mm = offset_mm + self._truth.plate_joints_apart(plate.theta_rad)[0][arm]
        elif self.kind.turns_point:
            offset_mm = _about(2, plate.theta_rad)[0] @ offset_mm
        return np.asarray(plate.position_mm + plate.rotation @ offset_mm)

    def settle(
        self, joints: Array, guess: Plate, growth: Growth = COLD, settled_mm: float = SETTLED_MM
    ) -> tuple[Plate, Array, Array]:
        """Solve the plate near a guess; also return the rods' misfits (2n,) mm, derivative (2n, u).

        Gauss–Newton until the last step was below `settled_mm`; raises `AssemblyLost` when that
        never comes.
        """
        elbows_mm = self.elbows_mm(joints, growth)
        unknowns = guess.unknowns
        for _ in range(ITERATIONS):
            misfits_mm, jacobian = self.misfit(elbows_mm, unknowns, growth)
            jacobian[:, 3:] /= RADIAN_AS_MM
            step_mm = np.linalg.lstsq(jacobian, -misfits_mm, rcond=None)[0]
            jacobian[:, 3:] *= RADIAN_AS_MM
            largest_mm = float(np.abs(step_mm).max())
            step_mm[3:] /= RADIAN_AS_MM
            unknowns = unknowns + step_mm
            if largest_mm < settled_mm:
                return Plate(unknowns), misfits_mm, jacobian
        listed = ", ".join(self.kind.text(joint, ".3f") for joint in joints)
        raise AssemblyLost(
            f"the plate does not settle at joints {listed}",
            remedy="stay away from the edge of the robot's reach",
        )


def turned(vectors: Array, axes: Array, angles_rad: Array) -> Array:
    """Turn vectors (n, 3), each about its unit axis by its angle (Rodrigues)."""
    cosine, sine = np.cos(angles_rad)[:, None], np.sin(angles_rad)[:, None]
    along = np.einsum("ij,ij->i", axes, vectors)[:, None] * axes
    return np.asarray(along + cosine * (vectors - along) + sine * np.cross(axes, vectors))


def _pairs(centres_mm: Array, half_bars_mm: Array) -> Array:
    """Return (2n, 3): both ends of each bar, arm by arm."""
    ends = np.stack([centres_mm - half_bars_mm, centres_mm + half_bars_mm], axis=1)
    return np.reshape(ends, (-1, 3))
