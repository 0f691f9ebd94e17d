"""Errors between encoders and joints: eccentric scales, gears, screws, sag under weight.

Two sides that must not agree by construction are in this file:

- the true robot. `Transmission.joints` computes the joints that really are at encoder readings:
  a ratio, an eccentric scale on the joint, and one on the motor that repeats with each of its
  turns. The misreading of a scale is the exact one of a circle that turns beside its centre.
  `Load.yielding` adds what gears give way under weights, by virtual work on the parts.
- a controller that can compensate. `readings_for` inverts the model of the parameters that `load`
  gives it (docs/explanation/model.md): a sine and a cosine, first order in the eccentricity.

A calibrated cell therefore keeps what first order neglects, as a real robot does. Play is not here,
since it depends on the way (driven_robot.py).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim.geometry import Array, Kind
from sim.robot.rods import Mechanism, Plate

READING_ROUNDS = 30
LEAST_MOTION = 1e-9
"""Motion below which a joint has stayed where it is, rad; of carriages times `Kind.scales`."""


@dataclass(frozen=True, slots=True, eq=False)
class Transmission:
    """True joints by encoder readings; each error has an entry for each joint, (n,)."""

    eccentricity: Array
    """Distance of a scale's centre from its axis over the scale's radius: largest error, rad."""
    phase_rad: Array
    """Reading at which the eccentricity's error crosses zero upward, rad."""
    ratio: Array
    """True ratio or pitch over the nominal one, less 1."""
    ripple: Array
    """Largest error in each turn of the motor, by an eccentric encoder there, rad or mm."""
    ripple_phase_rad: Array
    """Turn of the motor at which the ripple crosses zero upward, rad."""
    motor_rad: float | Array = 1.0
    """Turn of each motor for 1 rad or mm of its joint, rad: one for all, or (n,)."""

    @classmethod
    def perfect(cls, joints: int) -> "Transmission":
        """Return a transmission without any error."""
        return cls(*np.zeros((5, joints)))

    def joints(self, encoders: Array) -> Array:
        """Return the joints (N, n) or (n,) of encoders' readings of the same shape."""
        # The encoder on the motor misreads the motor's angle: in the joint's unit this error is
        # divided by the ratio, and it comes back with each of the motor's turns.
        turned = self.motor_rad * encoders - self.ripple_phase_rad
        of_motor = _misread_rad(turned, self.motor_rad * self.ripple) / self.motor_rad
        eccentric = _misread_rad(encoders - self.phase_rad, self.eccentricity)
        return np.asarray(encoders * (1.0 + self.ratio) + eccentric + of_motor)


def _misread_rad(reading_rad: Array, eccentricity: Array) -> Array:
    """Return the true angle less the reading of a scale whose centre is beside the axis."""
    # Let the axis be e radii from the scale's centre, toward reading 0. From there the mark of
    # reading φ is seen at φ + atan2(e sin φ, 1 - e cos φ); to first order the error is e sin φ.
    return np.asarray(
        np.arctan2(eccentricity * np.sin(reading_rad), 1.0 - eccentricity * np.cos(reading_rad))
    )


@dataclass(frozen=True, slots=True)
class Load:
    """Weights that gears carry, and how stiff those are."""

    at_elbow_n: float | Array = 0.0
    """Weight at the elbow of each arm, or of each carriage, (n,) or one for all."""
    at_plate_n: float = 0.0
    """Weight at the plate."""
    stiffness: float | Array = math.inf
    """Stiffness of each gear beyond its encoder, N mm/rad, or of a carriage's drive, N/mm, (n,)."""

    def yielding(self, mechanism: Mechanism, joints: Array, plate: Plate) -> Array:
        """Return the motion (n,) by which each joint gives way, rad or mm."""
        # A weight times its rise by a joint is that joint's torque; over the stiffness it is the
        # motion, against the rise. The encoder is on the motor's side and does not see it.
        elbow, whole = mechanism.heights_by_joints(joints, plate)
        return -(self.at_elbow_n * elbow + self.at_plate_n * whole) / self.stiffness


WEIGHTLESS = Load()


def readings_for(
    flat: Mapping[str, float], kind: Kind, ripple_rate: float | Array, joints: Array, present: Array
) -> Array:
    """Find the encoder readings (n,) at which arms stand at joints (n,), offsets left out.

    `present` are the readings (n,) from which the joints go there, `ripple_rate` is the change of a
    ripple's phase with the reading: one for all joints, or (n,).
    """
    # With q the reading, N the ripples' rate and s = ±1 the side that the joint moves to, an arm
    # stands at
    #
    #     q + k q + a sin q + b cos q + c sin Nq + d cos Nq - ½ β s
    #
    # 1. For either side q follows by substitution, since the errors change far more slowly than q.
    # 2. Of these two readings a joint takes the one for the side to which it moves. If both are
    #    above the present reading it rises, if both are below it falls; between them either is
    #    right for its own side, and the nearer one is taken.

    def column(stem: str) -> Array:
        units = enumerate(kind.units)
        return kind.inner([flat.get(f"arm{arm}.{stem}_{unit}", 0.0) for arm, unit in units])

    gain = 1e-6 * np.array([flat.get(f"arm{n}.encoder_gain_ppm", 0.0) for n in range(kind.arms)])
    a, b = column("eccentricity_sin"), column("eccentricity_cos")
    c, d, half = column("ripple_sin"), column("ripple_cos"), 0.5 * column("backlash")

    def reading(side: float) -> Array:
        q = joints
        for _ in range(READING_ROUNDS):
            errors = gain * q + a * np.sin(q) + b * np.cos(q)
            errors = errors + c * np.sin(ripple_rate * q) + d * np.cos(ripple_rate * q)
            q = joints - errors + half * side
        return q

    falling, rising = reading(-1.0), reading(1.0)
    tolerance = LEAST_MOTION * kind.scales
    goes_up = np.where(
        (present > falling - tolerance) & (present < rising + tolerance),
        present > 0.5 * (falling + rising),
        present <= falling - tolerance,
    )
    return np.where(goes_up, rising, falling)
