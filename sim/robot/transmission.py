"""Errors between encoders and joints: eccentric scales, gears, screws, sag under weight."""

import math
from dataclasses import dataclass

import numpy as np

from sim.geometry import Array
from sim.robot.rods import Plate, RodMechanism

DIFFERENCE = 1e-6
"""Step of a joint for the way of the elbows, rad or mm."""
HEIGHT = 2
"""Place of z among a plate's unknowns."""


@dataclass(frozen=True, slots=True, eq=False)
class Transmission:
    """True joints by what encoders read, each error an entry a joint, (n,)."""

    eccentricity: Array
    """Of a scale's centre over its radius: largest error, rad."""
    phase_rad: Array
    """Where that is."""
    ratio: Array
    """Ratio or pitch over what the controller believes, less 1."""
    ripple: Array
    """Largest error in each turn of the motor, rad or mm: of an eccentric encoder there."""
    ripple_phase_rad: Array
    """Where that is in the motor's turn."""
    motor_rad: float = 1.0
    """The motor's turn for 1 rad or mm of a joint."""

    @classmethod
    def perfect(cls, joints: int) -> "Transmission":
        """Without any error."""
        return cls(*np.zeros((5, joints)))

    def joints(self, encoders: Array) -> Array:
        """Joints (N, n) or (n,) of encoders' readings of the same shape."""
        turned = self.motor_rad * encoders - self.ripple_phase_rad
        of_motor = _misread_rad(turned, self.motor_rad * self.ripple) / self.motor_rad
        eccentric = _misread_rad(encoders - self.phase_rad, self.eccentricity)
        return np.asarray(encoders * (1.0 + self.ratio) + eccentric + of_motor)


def _misread_rad(reading_rad: Array, eccentricity: Array) -> Array:
    """True angle less the reading: the axis is that far beside the scale's centre."""
    return np.asarray(
        np.arctan2(eccentricity * np.sin(reading_rad), 1.0 - eccentricity * np.cos(reading_rad))
    )


@dataclass(frozen=True, slots=True)
class Load:
    """Weights that gears carry, and how stiff those are."""

    at_elbow_n: float = 0.0
    """Of each arm, or of each carriage."""
    at_plate_n: float = 0.0
    stiffness: float = math.inf
    """Of each gear beyond its encoder, N mm/rad, or of each drive of a carriage, N/mm."""

    def yielding(self, rods: RodMechanism, joints: Array, plate: Plate) -> Array:
        """(n,): by how much each joint gives way, rad or mm."""
        elbow, whole = heights_by_joints(rods, joints, plate)
        return -(self.at_elbow_n * elbow + self.at_plate_n * whole) / self.stiffness


WEIGHTLESS = Load()


def heights_by_joints(rods: RodMechanism, joints: Array, plate: Plate) -> tuple[Array, Array]:
    """Rise of its own elbow, and of the plate, by each joint, (n,) each.

    Times the weights there it is the torque of each joint, by virtual work.
    """
    elbows_mm = rods.elbows_mm(joints)
    _, by_plate = rods.misfit(elbows_mm, plate.unknowns)
    lift = np.linalg.pinv(by_plate)[HEIGHT]
    elbow, whole = np.empty(len(joints)), np.empty(len(joints))
    for joint in range(len(joints)):
        moved = joints.copy()
        moved[joint] += DIFFERENCE
        way = (rods.elbows_mm(moved) - elbows_mm) / DIFFERENCE
        elbow[joint] = way[2 * joint, HEIGHT]
        whole[joint] = lift @ np.einsum("ri,ri->r", by_plate[:, :3], way)
    return elbow, whole
