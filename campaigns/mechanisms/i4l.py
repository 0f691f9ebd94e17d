"""I4L: four carriages on rails, and two bars whose slide along x turns the tool.

What is held is what cannot be told of upright rails, as for the linear Delta; the bars' direction
is the base frame's x, which keeps it from turning and from tilting about y.
"""

from campaigns.mechanisms.closed_chain import HORIZONTAL, ClosedChain
from campaigns.mechanisms.i4r import SLIDE
from campaigns.mechanisms.linear_arms import LinearArms
from campaigns.mechanisms.linear_delta import FIRST_RAIL, UNTOLD_OF_EACH, UPRIGHT
from campaigns.mechanisms.platforms import SlidingBars

ARMS = 4

I4L = ClosedChain(
    "i4l",
    LinearArms,
    SlidingBars(shares=(0.0, 1.0)),
    held_fields=UPRIGHT,
    datum=(
        *FIRST_RAIL,
        *HORIZONTAL,
        *SLIDE,
        *(f"arm{arm}.{field}" for arm in range(ARMS) for field in UNTOLD_OF_EACH),
    ),
)
