"""H4: Par4's arms and hinged plate, the controlled point in the middle of the crossbar."""

from campaigns.mechanisms.arms import RotaryArms
from campaigns.mechanisms.closed_chain import ClosedChain
from campaigns.mechanisms.platforms import HingedPlate

H4 = ClosedChain("h4", RotaryArms, HingedPlate(shares=(-0.5, 0.5)), held_fields=("azimuth_deg",))
