"""I4R: four rotary arms, and two bars whose slide along x turns the tool (model.md, family)."""

from campaigns.mechanisms.arms import RotaryArms
from campaigns.mechanisms.closed_chain import HORIZONTAL, ClosedChain
from campaigns.mechanisms.platforms import SlidingBars

SLIDE = ("arm2.x_mm", "pinion_mm")
"""A shift of both sliding arms is a turn, and the pinion only scales turns: neither is measured."""

I4R = ClosedChain(
    "i4r",
    RotaryArms,
    SlidingBars(shares=(0.0, 1.0)),
    held_fields=("azimuth_deg",),
    # the bars' direction is the frame's x, so that every azimuth could be told
    datum=("arm0.x_mm", "arm0.y_mm", "arm0.z_mm", *SLIDE, *HORIZONTAL),
)
