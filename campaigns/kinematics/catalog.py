"""Catalog of the mechanisms by their word in robot files; a new member needs a line here.

The paper's method holds some parameters at nominal: azimuths (its hypothesis iii), the parameters
that place the base frame, and those that no measurement determines because rails are upright or the
platform slides. A parameter set for a plain controller (`export --format plain`) is fitted with the
same list. The model with priors needs no such list: there, every parameter is an unknown.
"""

from collections.abc import Mapping
from importlib.metadata import entry_points

from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.kinematics.five_bar import FiveBar
from campaigns.kinematics.hexapod import Hexaglide, Hexapod
from campaigns.kinematics.limbs import Carriage, Crank
from campaigns.kinematics.mechanism import Mechanism
from campaigns.kinematics.platforms import HingedPlate, Platform, SlidingBars

FIRST_PLACE = ("azimuth_deg", "arm0.x_mm", "arm0.y_mm", "arm0.z_mm")
UPRIGHT = ("azimuth_deg", "elevation_deg", "z_mm", "arm0.x_mm", "arm0.y_mm", "arm0.joint_offset_mm")
SLIDE = ("arm2.x_mm", "pinion_mm")
"""Parameters that points do not determine: a shift of both sliding arms is a turn, and the pinion
only scales turns."""

PAR4 = ClosedChain("par4", Crank(), HingedPlate(shares=(0.0, 0.0, 1.0, 1.0)), FIRST_PLACE)
"""Four cranks and an articulated plate (paper eqs. 1-18), controlled on its first half."""
H4 = ClosedChain("h4", Crank(), HingedPlate(shares=(-0.5, -0.5, 0.5, 0.5)), FIRST_PLACE)
"""Par4's arms and plate, the controlled point in the middle of the crossbar."""
I4R = ClosedChain("i4r", Crank(), SlidingBars(shares=(0.0, 0.0, 1.0, 1.0)), FIRST_PLACE + SLIDE)
"""Four cranks, and two bars whose slide along x turns the tool."""
I4L = ClosedChain("i4l", Carriage(), SlidingBars(shares=(0.0, 0.0, 1.0, 1.0)), UPRIGHT + SLIDE)
"""Four carriages, and I4R's sliding bars."""
DELTA = ClosedChain("delta", Crank(), Platform(), FIRST_PLACE)
"""Three cranks and a platform that only translates."""
LINEAR_DELTA = ClosedChain("linear-delta", Carriage(), Platform(), (*UPRIGHT, "arm1.x_mm"))
"""Three carriages and a platform that only translates."""

HEXAPOD = Hexapod("hexapod")
"""Six legs of variable length and a platform with six degrees of freedom."""
HEXAGLIDE = Hexaglide("hexaglide")
"""Six legs of fixed length on carriages, and a hexapod's platform."""
FIVE_BAR = FiveBar("five-bar")
"""Two cranks in a plane, whose forearms meet in a point."""

FAMILY: Mapping[str, ClosedChain] = {
    chain.name: chain for chain in (PAR4, H4, I4R, I4L, DELTA, LINEAR_DELTA)
}
"""Mechanisms of parallelograms under a plate."""
MECHANISMS: Mapping[str, Mechanism] = {
    **FAMILY,
    **{mechanism.name: mechanism for mechanism in (HEXAPOD, HEXAGLIDE, FIVE_BAR)},
}
ENTRY_POINTS = "pkmcal.mechanisms"
"""Group of entry points by which other packages offer mechanisms."""


def find_mechanism(word: object) -> Mechanism | None:
    """Return a mechanism by its word: shipped, or another package's.

    Return None for an unknown word; raise `ImportError`, `AttributeError` or `TypeError` where a
    package has no mechanism of that name.
    """
    if not isinstance(word, str) or word in MECHANISMS:
        return MECHANISMS.get(str(word))
    for offer in entry_points(group=ENTRY_POINTS, name=word):
        mechanism = offer.load()
        if not isinstance(mechanism, Mechanism) or mechanism.name != word:
            raise TypeError(f"{offer.value} is {mechanism!r}, must be a Mechanism named '{word}'")
        return mechanism
    return None
