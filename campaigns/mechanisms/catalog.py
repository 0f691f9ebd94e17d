"""Catalog of the mechanisms, by their word in robot files."""

from collections.abc import Mapping
from importlib.metadata import entry_points

from campaigns.mechanisms.closed_chain import ClosedChain
from campaigns.mechanisms.delta import DELTA
from campaigns.mechanisms.h4 import H4
from campaigns.mechanisms.i4l import I4L
from campaigns.mechanisms.i4r import I4R
from campaigns.mechanisms.linear_delta import LINEAR_DELTA
from campaigns.mechanisms.par4 import PAR4

MECHANISMS: Mapping[str, ClosedChain] = {
    each.name: each for each in (PAR4, H4, I4R, I4L, DELTA, LINEAR_DELTA)
}
OFFERED = "pkmcal.mechanisms"
"""Group of entry points by which other packages offer theirs."""


def find_mechanism(word: object) -> ClosedChain | None:
    """Mechanism by its word, shipped or another package's; None where there is none.

    Raises `TypeError` for a package that offers something else.
    """
    if not isinstance(word, str) or word in MECHANISMS:
        return MECHANISMS.get(str(word))
    for each in entry_points(group=OFFERED, name=word):
        chain = each.load()
        if not isinstance(chain, ClosedChain) or chain.name != word:
            raise TypeError(f"{each.value} is {chain!r}, must be a ClosedChain named '{word}'")
        return chain
    return None
