"""The names of the 29 geometrical parameters (paper eq. 1) in files, reports and commands."""

ARMS = 4
ARM_FIELDS = ("x_mm", "y_mm", "z_mm", "azimuth_deg", "joint_offset_deg", "arm_mm", "forearm_mm")
PARAMETER_NAMES: tuple[str, ...] = (
    *(f"arm{arm}.{field}" for arm in range(ARMS) for field in ARM_FIELDS),
    "plate_mm",
)
"""The order of every list of parameters: arm by arm, then the plate."""
