"""Delta: three rotary arms and a platform that only translates (model.md, family)."""

from campaigns.mechanisms.arms import RotaryArms
from campaigns.mechanisms.closed_chain import ClosedChain
from campaigns.mechanisms.platforms import TranslatingPlatform

DELTA = ClosedChain("delta", RotaryArms, TranslatingPlatform(), held_fields=("azimuth_deg",))
