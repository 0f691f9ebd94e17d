"""The 29 geometrical parameters of Par4 (paper eq. 1) as arrays, and their flat names."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from campaigns.parameters import ARM_FIELDS, ARMS, PARAMETER_NAMES

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

NAMES = PARAMETER_NAMES

COUNT = len(NAMES)
IS_ANGLE: Mask = np.array([name.endswith("_deg") for name in NAMES])
FILE_UNIT = np.where(IS_ANGLE, np.pi / 180.0, 1.0)
"""Multiplies a value in file units (mm, deg) to give inner units (mm, rad)."""

HELD_BY_DEFAULT = (
    "arm0.x_mm",
    "arm0.y_mm",
    "arm0.z_mm",
    *(f"arm{i}.azimuth_deg" for i in range(ARMS)),
)
"""The first motor places the frame; the azimuths are hypothesis (iii) of the paper."""

FREE_BY_DEFAULT = tuple(name for name in NAMES if name not in HELD_BY_DEFAULT)


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """A parameter set: mm and rad, one row an arm."""

    motor_mm: Array
    """P_i in the base frame, (4, 3)."""
    azimuth_rad: Array
    """α_i, (4,)."""
    joint_offset_rad: Array
    """δq_i: joint angle minus encoder reading, (4,)."""
    arm_mm: Array
    """l_i, (4,)."""
    forearm_mm: Array
    """L_i, (4,)."""
    plate_mm: float
    """h."""

    @classmethod
    def from_vector(cls, vector: Array) -> "Geometry":
        """From 29 values in the order of `NAMES`, mm and rad."""
        arms = np.asarray(vector[:-1], dtype=np.float64).reshape(ARMS, len(ARM_FIELDS))
        return cls(arms[:, :3], arms[:, 3], arms[:, 4], arms[:, 5], arms[:, 6], float(vector[-1]))

    @classmethod
    def from_flat(cls, flat: Mapping[str, float]) -> "Geometry":
        """From flat names in file units (mm, deg); raises `KeyError` for a missing one."""
        return cls.from_vector(np.array([flat[name] for name in NAMES]) * FILE_UNIT)

    def vector(self) -> Array:
        """29 values in the order of `NAMES`, mm and rad."""
        arms = np.column_stack(
            [self.motor_mm, self.azimuth_rad, self.joint_offset_rad, self.arm_mm, self.forearm_mm]
        )
        return np.append(arms.ravel(), self.plate_mm)

    def flat(self) -> dict[str, float]:
        """By flat name, in file units."""
        return dict(zip(NAMES, (self.vector() / FILE_UNIT).tolist(), strict=True))


def indices(names: tuple[str, ...]) -> Index:
    """Places of the named parameters in a vector; raises `ValueError` for an unknown name."""
    return np.array([NAMES.index(name) for name in names], dtype=np.intp)
