"""Catalog of the mechanisms, by their word in robot files."""

from collections.abc import Mapping

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
