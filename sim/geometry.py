"""A Par4's 29 parameters for the simulator's own use: flat names outside, arrays inside."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ARMS = 4
ARM_FIELDS = (
    "x_mm",
    "y_mm",
    "z_mm",
    "azimuth_deg",
    "joint_offset_deg",
    "arm_mm",
    "forearm_mm",
)
FLAT_NAMES = (
    *(f"arm{arm}.{field}" for arm in range(ARMS) for field in ARM_FIELDS),
    "plate_mm",
)
LENGTH_FIELDS = ("arm_mm", "forearm_mm", "plate_mm")

UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """The contracted parameters (paper, eq. 1) as arrays, one row an arm, in the base frame."""

    motors_mm: Array
    """(4, 3): the contracted motor centres P_i."""
    azimuths_rad: Array
    """(4,)"""
    joint_offsets_rad: Array
    """(4,): arm angle = encoder + offset."""
    arms_mm: Array
    """(4,)"""
    forearms_mm: Array
    """(4,)"""
    plate_mm: float

    @property
    def outward(self) -> Array:
        """(4, 3): u_i, where the arms point at 0°."""
        return np.column_stack(
            [np.cos(self.azimuths_rad), np.sin(self.azimuths_rad), np.zeros(ARMS)]
        )

    @property
    def sideways(self) -> Array:
        """(4, 3): v_i, the motor axes without any tilt."""
        return np.column_stack(
            [-np.sin(self.azimuths_rad), np.cos(self.azimuths_rad), np.zeros(ARMS)]
        )


def _prototype() -> dict[str, float]:
    """Table I read as a robot that works: radial arms and forearms of 700 mm."""
    corners = (
        (-172.5, -222.5, 225.0),
        (172.5, -222.5, 315.0),
        (172.5, 222.5, 45.0),
        (-172.5, 222.5, 135.0),
    )
    flat = {}
    for arm, (x_mm, y_mm, azimuth_deg) in enumerate(corners):
        values = (x_mm, y_mm, 0.0, azimuth_deg, 0.0, 350.0, 700.0)
        flat.update({f"arm{arm}.{f}": v for f, v in zip(ARM_FIELDS, values, strict=True)})
    return {**flat, "plate_mm": 100.0}


NOMINAL_ROBOTS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {"par4-prototype": MappingProxyType(_prototype())}
)


def problem_with(flat: Mapping[str, float]) -> str:
    """Reason why these flat parameters are no robot: the first thing wrong, or nothing."""
    if missing := [name for name in FLAT_NAMES if name not in flat]:
        return f"{missing[0]} is missing"
    if unknown := [name for name in flat if name not in FLAT_NAMES]:
        return f"{unknown[0]} is no parameter of this robot"
    for name in FLAT_NAMES:
        if not math.isfinite(flat[name]):
            return f"{name} is {flat[name]}, not a finite number"
        if name.endswith(LENGTH_FIELDS) and flat[name] <= 0.0:
            return f"{name} is {flat[name]:g} mm, and a length is above 0"
    return ""


def geometry_of(flat: Mapping[str, float]) -> Geometry:
    """Arrays from flat parameters that `problem_with` finds nothing wrong with."""
    column = {
        field: np.array([flat[f"arm{arm}.{field}"] for arm in range(ARMS)]) for field in ARM_FIELDS
    }
    return Geometry(
        motors_mm=np.column_stack([column["x_mm"], column["y_mm"], column["z_mm"]]),
        azimuths_rad=np.radians(column["azimuth_deg"]),
        joint_offsets_rad=np.radians(column["joint_offset_deg"]),
        arms_mm=column["arm_mm"],
        forearms_mm=column["forearm_mm"],
        plate_mm=float(flat["plate_mm"]),
    )
