"""The names of the 29 parameters (paper eq. 1), and of those beyond, in files and commands."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from campaigns.arrays import Array, Index, Mask

ARMS = 4
ARM_FIELDS = ("x_mm", "y_mm", "z_mm", "azimuth_deg", "joint_offset_deg", "arm_mm", "forearm_mm")
PARAMETER_NAMES: tuple[str, ...] = (
    *(f"arm{arm}.{field}" for arm in range(ARMS) for field in ARM_FIELDS),
    "plate_mm",
)
"""The order of every list of parameters: arm by arm, then the plate."""

AXIS_TILT_NAMES: tuple[str, ...] = tuple(f"arm{arm}.axis_tilt_deg" for arm in range(ARMS))
"""Beyond the 29: motor axes out of the horizontal. Robot files know them, controllers don't."""
BACKLASH_NAMES: tuple[str, ...] = tuple(f"arm{arm}.backlash_deg" for arm in range(ARMS))
"""Beyond the geometry: lost motion of each gear, from one side to the other. In no file."""

NAMES = PARAMETER_NAMES
"""The 29 of files and controllers."""
GEOMETRY_NAMES = NAMES + AXIS_TILT_NAMES
"""The 33 that a `Geometry` holds, in the order of its vector."""
MODEL_NAMES = GEOMETRY_NAMES + BACKLASH_NAMES
"""The 37 that a fit may free."""

IS_ANGLE: Mask = np.array([name.endswith("_deg") for name in MODEL_NAMES])
FILE_UNIT = np.where(IS_ANGLE, np.pi / 180.0, 1.0)
"""Multiplies a value in file units (mm, deg) to give inner units (mm, rad)."""


def indices(names: tuple[str, ...]) -> Index:
    """Places of the named parameters in `MODEL_NAMES`; raises `ValueError` for an unknown name."""
    return np.array([MODEL_NAMES.index(name) for name in names], dtype=np.intp)


PLATE = NAMES.index("plate_mm")
OFFSETS = indices(tuple(f"arm{arm}.joint_offset_deg" for arm in range(ARMS)))
TILTS = indices(AXIS_TILT_NAMES)
BACKLASHES = indices(BACKLASH_NAMES)

HELD_BY_DEFAULT = (
    "arm0.x_mm",
    "arm0.y_mm",
    "arm0.z_mm",
    *(f"arm{i}.azimuth_deg" for i in range(ARMS)),
)
"""The first motor places the frame; the azimuths are hypothesis (iii) of the paper."""

FREE_BY_DEFAULT = tuple(name for name in NAMES if name not in HELD_BY_DEFAULT)

HELD_IF_EXTENDED = HELD_BY_DEFAULT[:4]
"""The first arm's azimuth stays held too: it keeps the frame from turning about z."""

FREE_IF_EXTENDED = tuple(name for name in MODEL_NAMES if name not in HELD_IF_EXTENDED)
"""All that measurements with known directions of approach can tell apart: 33."""


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
    axis_tilt_rad: Array = field(default_factory=lambda: np.zeros(ARMS))
    """τ_i: motor axis out of the horizontal, turned about u_i, (4,)."""

    @classmethod
    def from_vector(cls, vector: Array) -> "Geometry":
        """From 33 values in the order of `GEOMETRY_NAMES`, mm and rad."""
        values = np.asarray(vector, dtype=np.float64)
        arms = values[:PLATE].reshape(ARMS, len(ARM_FIELDS))
        plate_mm, tilts = float(values[PLATE]), values[TILTS]
        return cls(arms[:, :3], arms[:, 3], arms[:, 4], arms[:, 5], arms[:, 6], plate_mm, tilts)

    @classmethod
    def from_flat(cls, flat: Mapping[str, float]) -> "Geometry":
        """From flat names in file units (mm, deg); an axis tilt that is not named is 0.

        Raises `KeyError` when one of the 29 is missing.
        """
        values = [flat[name] for name in NAMES] + [flat.get(name, 0.0) for name in AXIS_TILT_NAMES]
        return cls.from_vector(np.array(values) * FILE_UNIT[: len(GEOMETRY_NAMES)])

    def vector(self) -> Array:
        """33 values in the order of `GEOMETRY_NAMES`, mm and rad."""
        arms = np.column_stack(
            [self.motor_mm, self.azimuth_rad, self.joint_offset_rad, self.arm_mm, self.forearm_mm]
        )
        return np.concatenate([arms.ravel(), [self.plate_mm], self.axis_tilt_rad])

    def flat(self) -> dict[str, float]:
        """By flat name, in file units: the 29, and the axis tilts that are not 0."""
        values = (self.vector() / FILE_UNIT[: len(GEOMETRY_NAMES)]).tolist()
        named = zip(GEOMETRY_NAMES, values, strict=True)
        return {name: value for name, value in named if name in NAMES or value}
