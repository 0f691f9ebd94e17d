"""Numbers as text for files."""

import math

ANGLE_DECIMALS = 12
"""Of a degree: far below what any encoder tells, and far above what converting to rad and back
loses. So a file that was read and written again is the same file."""


def number_text(value: float) -> str:
    """Write the shortest decimals that give the double again."""
    return repr(float(value) + 0.0)  # -0.0 becomes 0.0


def angle_text(angle_rad: float) -> str:
    """Write an angle in deg, to `ANGLE_DECIMALS`."""
    return number_text(round(math.degrees(angle_rad), ANGLE_DECIMALS))
