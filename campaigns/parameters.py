"""The names of the 29 parameters (paper eq. 1), and of those beyond, in files and commands."""

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
