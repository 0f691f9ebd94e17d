"""Catalog of the mechanisms, by their word in robot files."""

from collections.abc import Mapping

from campaigns.mechanisms.delta import DELTA
from campaigns.mechanisms.mechanism import Mechanism
from campaigns.mechanisms.par4 import PAR4

MECHANISMS: Mapping[str, Mechanism] = {each.name: each for each in (PAR4, DELTA)}
