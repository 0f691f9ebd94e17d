"""Linear Delta: three carriages on rails and a platform that only translates.

What is held is what cannot be told of upright rails: where on its rail a zero lies, but for the
offset; where the frame is; and its turn about the vertical.
"""

from campaigns.mechanisms.closed_chain import HORIZONTAL, ClosedChain
from campaigns.mechanisms.linear_arms import LinearArms
from campaigns.mechanisms.platforms import TranslatingPlatform

ARMS = 3
UPRIGHT = ("azimuth_deg", "elevation_deg", "z_mm")
FIRST_RAIL = ("arm0.x_mm", "arm0.y_mm", "arm0.joint_offset_mm", "arm0.rail_tilt_deg")
"""The first rail's place and its direction are the frame's."""
UNTOLD_OF_EACH = ("azimuth_deg", "z_mm")
"""An upright rail has no azimuth, and its zero's height is its offset."""

LINEAR_DELTA = ClosedChain(
    "linear-delta",
    LinearArms,
    TranslatingPlatform(),
    held_fields=UPRIGHT,
    datum=(
        *FIRST_RAIL,
        *HORIZONTAL,
        "arm0.elevation_deg",
        "arm1.x_mm",
        *(f"arm{arm}.{field}" for arm in range(ARMS) for field in UNTOLD_OF_EACH),
    ),
)
