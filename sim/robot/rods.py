"""Rotations by three angles about fixed axes, with their derivatives."""

import math
from dataclasses import dataclass

import numpy as np

from sim.errors import AssemblyLost
from sim.geometry import ARMS, UP, Array, Geometry


def _about(axis: int, angle_rad: float) -> tuple[Array, Array]:
    """The rotation about one axis and its derivative."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    turn, rate = np.eye(3), np.zeros((3, 3))
    turn[first, first] = turn[second, second] = cosine
    turn[first, second], turn[second, first] = -sine, sine
    rate[first, first] = rate[second, second] = -sine
    rate[first, second], rate[second, first] = -cosine, cosine
    return turn, rate


def rotation(about_x: float, about_y: float, about_z: float) -> Array:
    """(3, 3): turned about x, then y, then z of the fixed frame, rad."""
    return np.asarray(_about(2, about_z)[0] @ _about(1, about_y)[0] @ _about(0, about_x)[0])


def rotation_and_rates(about_x: float, about_y: float, about_z: float) -> tuple[Array, Array]:
    """Rotation (3, 3), and its derivatives (3, 3, 3) by the three angles."""
    (x, dx), (y, dy), (z, dz) = _about(0, about_x), _about(1, about_y), _about(2, about_z)
    zy = z @ y
    return zy @ x, np.stack([zy @ dx, z @ dy @ x, dz @ y @ x])


RODS = 2 * ARMS
UNKNOWNS = 7
RADIAN_AS_MM = 100.0
"""Length by which a step in angle is compared with one in position."""
SETTLED_MM = 1e-9
"""A step this small leaves an error at the rounding of the figures: convergence is fast."""
ITERATIONS = 25
ON_HALF_2 = np.repeat([0.0, 0.0, 1.0, 1.0], 2)


@dataclass(frozen=True, slots=True, eq=False)
class Build:
    """Departures of the mechanism from its contracted model, in sizes and in errors."""

    plate_joints_mm: Array
    """(4, 3): b_i, where the bars sit on the plate as seen from B'_i."""
    rod_spacing_mm: float
    rod_errors_mm: Array
    """(4, 2): each rod's length less its forearm's."""
    axis_tilts_rad: Array
    """(4,): motor axes out of the horizontal, turned about the arm's direction at 0°."""


@dataclass(frozen=True, slots=True, eq=False)
class Plate:
    """Place of the plate: B'_0, the orientation of half 1, and the bar's angle on it."""

    unknowns: Array
    """(7,): x, y, z mm; rotations about x, y, z in rad, applied in that order; θ rad."""

    @property
    def position_mm(self) -> Array:
        """(3,): B'_0 in the base frame."""
        return self.unknowns[:3]

    @property
    def rotation(self) -> Array:
        """(3, 3): base_from_plate."""
        return rotation(*self.unknowns[3:6])

    @property
    def theta_rad(self) -> float:
        """The bar's angle on half 1."""
        return float(self.unknowns[6])


class EightRods:
    """The mechanism's parts and their closure. Holds no state: joints in, plate out."""

    def __init__(self, truth: Geometry, build: Build) -> None:
        sine, cosine = np.sin(build.axis_tilts_rad), np.cos(build.axis_tilts_rad)
        sideways, half_bar_mm = truth.sideways, 0.5 * build.rod_spacing_mm
        axes = cosine[:, None] * sideways + sine[:, None] * UP
        self._motors_mm = truth.motors_mm + build.plate_joints_mm
        self._offsets_rad = truth.joint_offsets_rad
        self._arms_mm = truth.arms_mm
        self._outward = truth.outward
        self._down = sine[:, None] * sideways - cosine[:, None] * UP
        self._elbow_bar_mm = half_bar_mm * axes
        self._anchors_mm = _pairs(build.plate_joints_mm, half_bar_mm * sideways)
        self._rods_mm = (truth.forearms_mm[:, None] + build.rod_errors_mm).reshape(RODS)
        self._plate_mm = truth.plate_mm

    def elbows_mm(self, joints: Array, growth: float) -> Array:
        """(8, 3): the rods' upper ends in the base frame; arms longer by the fraction `growth`."""
        angles = joints + self._offsets_rad
        arms = np.cos(angles)[:, None] * self._outward + np.sin(angles)[:, None] * self._down
        lengths_mm = (self._arms_mm * (1.0 + growth))[:, None]
        return _pairs(self._motors_mm + lengths_mm * arms, self._elbow_bar_mm)

    def misfit(self, elbows_mm: Array, unknowns: Array) -> tuple[Array, Array]:
        """Excess of the gaps over the rods' lengths, (8,) mm, and its derivative (8, 7)."""
        turn, rates = rotation_and_rates(*unknowns[3:6])
        sine, cosine = math.sin(unknowns[6]), math.cos(unknowns[6])
        bar_mm = self._plate_mm * np.array([-sine, cosine, 0.0])
        bar_rate_mm = self._plate_mm * np.array([-cosine, -sine, 0.0])
        on_plate_mm = self._anchors_mm + ON_HALF_2[:, None] * bar_mm
        gaps_mm = unknowns[:3] + on_plate_mm @ turn.T - elbows_mm
        lengths_mm = np.sqrt(np.einsum("ij,ij->i", gaps_mm, gaps_mm))
        along = gaps_mm / lengths_mm[:, None]
        jacobian = np.empty((RODS, UNKNOWNS))
        jacobian[:, :3] = along
        jacobian[:, 3:6] = np.einsum("ri,kij,rj->rk", along, rates, on_plate_mm)
        jacobian[:, 6] = ON_HALF_2 * (along @ (turn @ bar_rate_mm))
        return lengths_mm - self._rods_mm, jacobian

    def settle(
        self, joints: Array, growth: float, guess: Plate, settled_mm: float = SETTLED_MM
    ) -> tuple[Plate, Array, Array]:
        """The plate near a guess, with the rods' misfits (8,) mm and their derivative (8, 7).

        Gauss–Newton until the last step was below `settled_mm`; raises `AssemblyLost` when that
        never comes.
        """
        elbows_mm = self.elbows_mm(joints, growth)
        unknowns = guess.unknowns
        for _ in range(ITERATIONS):
            misfits_mm, jacobian = self.misfit(elbows_mm, unknowns)
            jacobian[:, 3:] /= RADIAN_AS_MM
            step_mm = np.linalg.lstsq(jacobian, -misfits_mm, rcond=None)[0]
            jacobian[:, 3:] *= RADIAN_AS_MM
            largest_mm = float(np.abs(step_mm).max())
            step_mm[3:] /= RADIAN_AS_MM
            unknowns = unknowns + step_mm
            if largest_mm < settled_mm:
                return Plate(unknowns), misfits_mm, jacobian
        raise AssemblyLost(
            f"the plate does not settle at joints {_degrees(joints)}",
            remedy="stay away from the edge of the robot's reach",
        )


def _pairs(centres_mm: Array, half_bars_mm: Array) -> Array:
    """(8, 3): both ends of four bars, arm by arm."""
    ends = np.stack([centres_mm - half_bars_mm, centres_mm + half_bars_mm], axis=1)
    return np.reshape(ends, (RODS, 3))


def _degrees(joints: Array) -> str:
    return ", ".join(f"{angle:.3f}°" for angle in np.degrees(joints))
