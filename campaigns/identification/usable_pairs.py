"""Which pairs of shots can be used, and why the others cannot."""

from dataclasses import dataclass

from campaigns.identification.identified import Excluded
from campaigns.numerics.geometry import Index, Mask
from campaigns.numerics.par4 import Solution
from campaigns.shot_sets import ShotSet
from campaigns.shots.dataset import Dataset


@dataclass(frozen=True, slots=True, eq=False)
class UsablePairs:
    """Whole pairs of a set, rows (M, 2), at both shots of which the robot can be assembled."""

    rows: Index
    excluded: tuple[Excluded, ...]


def usable_pairs(nominal: Solution, data: Dataset, purpose: ShotSet) -> UsablePairs:
    """Those of a set, and the others by name, from the nominal robot's poses at all shots."""
    found = nominal.found
    halves = tuple(
        Excluded(f"shot {data.numbers[row]} has no partner", pair=pair_of(data, row))
        for row in data.half_pairs(purpose)
    )
    rows = data.pair_rows(purpose)
    whole = found[rows].all(axis=1)
    return UsablePairs(rows[whole], halves + without_assembly(data, rows[~whole], found, "nominal"))


def without_assembly(data: Dataset, pairs: Index, found: Mask, which: str) -> tuple[Excluded, ...]:
    """Say of pairs (M, 2) at which of their shots there is no assembly."""
    return tuple(
        Excluded(
            f"the {which} robot cannot be assembled at the joints of shot {data.numbers[row]}",
            pair=pair_of(data, row),
        )
        for pair in pairs.tolist()
        for row in pair
        if not found[row]
    )


def pair_of(data: Dataset, row: int) -> int:
    """The number of a shot's pair."""
    pair = data.pairs[row]
    assert pair is not None, "only shots of pairs are asked for"
    return pair
