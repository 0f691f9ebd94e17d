"""Random streams: a draw depends on the seed, what it is for, and which try it is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

WORD = 2**64


class Purpose(IntEnum):
    """Purpose of a draw. The numbers are part of what a seed means: never renumber."""

    MANUFACTURE = 1
    ARRIVAL = 2
    SHOT = 3
    RODS = 4
    TILTS = 5
    TRANSMISSION = 6


def generator(seed: int, purpose: Purpose, *keys: int) -> np.random.Generator:
    """Return the generator of a seed, purpose and keys (any whole numbers)."""
    words = [key % WORD for key in (seed, purpose, *keys)]
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(words)))


def target_key(joints: Sequence[float]) -> tuple[int, ...]:
    """Return a joint target as whole microdegrees, which names it for ever."""
    return tuple(round(float(np.degrees(joint)) * 1e6) for joint in joints)


class Attempts:
    """Counts of how often something was done at each target, all from `before` on."""

    def __init__(self, counts: Mapping[str, int], before: int = 0) -> None:
        self._counts = dict(counts)
        self._before = before

    def next(self, key: tuple[int, ...]) -> int:
        """Count one more attempt at a target and return its number, the first `before` + 1."""
        name = ",".join(map(str, key))
        self._counts[name] = self._counts.get(name, self._before) + 1
        return self._counts[name]

    def memory(self) -> dict[str, int]:
        """Return the counts so far."""
        return dict(self._counts)


@dataclass(slots=True)
class WorkedTime:
    """Nominal seconds that the cell has moved and measured; what slow effects follow.

    Not the wall clock, so that a slow machine draws the same figures.
    """

    seconds: float
    """So far, over all restarts."""
