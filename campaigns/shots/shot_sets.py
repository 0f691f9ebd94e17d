"""Sets of shots, by what they are for, and the pairs in them."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from campaigns.arrays import Index

SHOTS_OF_A_PAIR = 2


class ShotSet(Enum):
    """A set of shots; the value is the word in files."""

    IDENTIFICATION = "identification"
    VALIDATION = "validation"
    DRIFT = "drift"
    REPEATABILITY = "repeatability"
    ROTATION = "rotation"
    STRAIGHTNESS = "straightness"
    KNOWN_LENGTH = "known-length"
    NEST = "nest"
    ISO_CUBE = "iso-cube"
    CHECK = "check"

    @property
    def in_pairs(self) -> bool:
        """Whether its shots stand in pairs, each of two points at some distance."""
        return self in IN_PAIRS

    @property
    def on_robot(self) -> bool:
        """Whether it is the robot's reflector that is measured."""
        return self not in OFF_ROBOT


IN_PAIRS = (ShotSet.IDENTIFICATION, ShotSet.VALIDATION, ShotSet.KNOWN_LENGTH)
OFF_ROBOT = (ShotSet.KNOWN_LENGTH, ShotSet.NEST)


@dataclass(frozen=True, slots=True, eq=False)
class PairRows:
    """Whole pairs by their numbers, their rows (M, 2), and rows whose partner is missing."""

    numbers: tuple[int, ...]
    rows: Index
    halves: tuple[int, ...]


def pair_rows(pairs: Sequence[int | None]) -> PairRows:
    """Return the pairs by the shots' pair numbers; None stands for a shot without a pair."""
    rows: dict[int, list[int]] = {}
    for row, pair in enumerate(pairs):
        if pair is not None:
            rows.setdefault(pair, []).append(row)
    # A run that was broken off may have measured one shot of a pair: that is no error, but counts
    # for nothing until the other one is there.
    whole = {pair: both for pair, both in rows.items() if len(both) == SHOTS_OF_A_PAIR}
    halves = [row for half in rows.values() if len(half) < SHOTS_OF_A_PAIR for row in half]
    both = np.array(list(whole.values()), dtype=np.intp).reshape(-1, SHOTS_OF_A_PAIR)
    return PairRows(tuple(whole), both, tuple(halves))
