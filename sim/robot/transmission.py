"""Errors between encoders and joints: eccentric scales, gears, screws, sag under weight."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim.geometry import Array, Kind
from sim.robot.rods import Plate, RodMechanism

DIFFERENCE = 1e-6
"""Step of a joint for the way of the elbows, rad or mm."""
HEIGHT = 2
"""Place of z among a plate's unknowns."""
ROUNDS = 30
STANDS = 1e-9
"""Way below which a joint stays where it is, rad; of carriages in `Kind.scale`."""


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
        """Return a transmission without any error."""
        return cls(*np.zeros((5, joints)))

    def joints(self, encoders: Array) -> Array:
        """Return the joints (N, n) or (n,) of encoders' readings of the same shape."""
        turned = self.motor_rad * encoders - self.ripple_phase_rad
        of_motor = _misread_rad(turned, self.motor_rad * self.ripple) / self.motor_rad
        eccentric = _misread_rad(encoders - self.phase_rad, self.eccentricity)
        return np.asarray(encoders * (1.0 + self.ratio) + eccentric + of_motor)


def _misread_rad(reading_rad: Array, eccentricity: Array) -> Array:
    """Return the true angle less the reading of a scale whose centre is beside the axis."""
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
        """Return (n,): by how much each joint gives way, rad or mm."""
        elbow, whole = heights_by_joints(rods, joints, plate)
        return -(self.at_elbow_n * elbow + self.at_plate_n * whole) / self.stiffness


WEIGHTLESS = Load()


def heights_by_joints(rods: RodMechanism, joints: Array, plate: Plate) -> tuple[Array, Array]:
    """Return the rise of its own elbow, and of the plate, by each joint, (n,) each.

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


def readings_for(
    flat: Mapping[str, float], kind: Kind, ripple_rate: float, joints: Array, present: Array
) -> Array:
    """Find the encoder readings (n,) at which arms stand at joints (n,), offsets aside.

    With q the reading, N the ripples' rate and s = ±1 the way that a joint last went, an arm stands
    at q + k q + a sin q + b cos q + c sin Nq + d cos Nq - ½ β s. The errors change far more slowly
    than q, so that q follows by substitution. Of the two readings of a joint, one from each side,
    it is the one beyond where the joint is at present; between them the nearer one.
    """

    def column(stem: str) -> Array:
        key = f"{stem}_{kind.unit}"
        values = [flat.get(f"arm{arm}.{key}", 0.0) for arm in range(kind.arms)]
        return np.array([kind.inner(value) for value in values])

    gain = 1e-6 * np.array([flat.get(f"arm{n}.encoder_gain_ppm", 0.0) for n in range(kind.arms)])
    a, b = column("eccentricity_sin"), column("eccentricity_cos")
    c, d, half = column("ripple_sin"), column("ripple_cos"), 0.5 * column("backlash")

    def reading(side: float) -> Array:
        q = joints
        for _ in range(ROUNDS):
            errors = gain * q + a * np.sin(q) + b * np.cos(q)
            errors = errors + c * np.sin(ripple_rate * q) + d * np.cos(ripple_rate * q)
            q = joints - errors + half * side
        return q

    falling, rising = reading(-1.0), reading(1.0)
    stands = STANDS * kind.scale
    goes_up = np.where(
        (present > falling - stands) & (present < rising + stands),
        present > 0.5 * (falling + rising),
        present <= falling - stands,
    )
    return np.where(goes_up, rising, falling)
