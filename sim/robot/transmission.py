"""Errors between encoders and joints: eccentric scales, gears' ratios, screws, sag under weight."""

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
    wobble_mm: Array
    """Largest error of a screw in each of its turns."""
    pitch_mm: float = 10.0
    """Of the screws."""

    @classmethod
    def perfect(cls, joints: int) -> "Transmission":
        """Without any error."""
        return cls(*np.zeros((4, joints)))

    def joints(self, encoders: Array) -> Array:
        """Joints (N, n) of encoders' readings (N, n)."""
        # the axis is that far beside the scale's centre, from where the reading is an angle
        seen = encoders - self.phase_rad
        eccentric = np.arctan2(
            self.eccentricity * np.sin(seen), 1.0 - self.eccentricity * np.cos(seen)
        )
        screw = self.wobble_mm * np.sin(2.0 * np.pi * encoders / self.pitch_mm - self.phase_rad)
        return np.asarray(encoders * (1.0 + self.ratio) + eccentric + screw)


def height_by_joints(rods: RodMechanism, joints: Array, plate: Plate) -> Array:
    """Rise of the plate by each joint, (n,): its weight's torques, by virtual work."""
    elbows_mm = rods.elbows_mm(joints, 0.0)
    _, by_plate = rods.misfit(elbows_mm, plate.unknowns)
    lift = np.linalg.pinv(by_plate)[HEIGHT]
    found = np.empty(len(joints))
    for joint in range(len(joints)):
        moved = joints.copy()
        moved[joint] += DIFFERENCE
        way = (rods.elbows_mm(moved, 0.0) - elbows_mm) / DIFFERENCE
        found[joint] = lift @ np.einsum("ri,ri->r", by_plate[:, :3], way)
    return found
