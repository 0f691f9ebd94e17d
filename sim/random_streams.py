"""Random streams: each draw depends on the seed, its purpose, its target and its attempt.

One generator for the whole cell would make every draw depend on all draws before it: a repeated
shot, a resumed run or a second process would shift the noise of everything later, and no two
campaigns could be compared. So there is a stream for each purpose and, for what happens many times,
for each target and attempt there:

1. manufacture (geometry, rods, tilts, transmission) is drawn once from (seed, purpose), and where
   a reflector that is carried sits on its part, or what an instrument is read of, from (seed,
   purpose, its name);
2. an arrival or a shot is drawn from (seed, purpose, joint target, number of the attempt there).

The counts of attempts are in the cell's memory. The third visit of a pose therefore scatters alike
in one process and in ten, whatever was done between the visits.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

DISTINCT_KEYS = 2**64
"""Keys wrap round at this number, since a seed sequence takes no negative ones."""


class Purpose(IntEnum):
    """Purpose of a draw. The numbers are part of what a seed means: never renumber."""

    MANUFACTURE = 1
    ARRIVAL = 2
    SHOT = 3
    RODS = 4
    TILTS = 5
    TRANSMISSION = 6
    MOUNT = 7
    OBJECT = 8
    READING = 9


def generator(seed: int, purpose: Purpose, *keys: int) -> np.random.Generator:
    """Return the generator of a seed, purpose and keys (any whole numbers)."""
    words = [key % DISTINCT_KEYS for key in (seed, purpose, *keys)]
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(words)))


def target_key(joints: Sequence[float]) -> tuple[int, ...]:
    """Return the key of a joint target: its joints in whole microdegrees.

    Carriages' millimetres are converted as if they were radians: a key needs no unit.
    """
    # rounded: the last bits of a float may depend on how a target was computed
    return tuple(round(float(np.degrees(joint)) * 1e6) for joint in joints)


class Attempts:
    """Streams of one purpose by target, with a count of the attempts at each, from `before` on."""

    def __init__(
        self, seed: int, purpose: Purpose, counts: Mapping[str, int], before: int = 0
    ) -> None:
        self._seed = seed
        self._purpose = purpose
        self._counts = dict(counts)
        self._before = before

    def next_generator(self, target: tuple[int, ...]) -> np.random.Generator:
        """Count one more attempt at a target, the first `before` + 1, and return its generator."""
        name = ",".join(map(str, target))
        self._counts[name] = self._counts.get(name, self._before) + 1
        return generator(self._seed, self._purpose, *target, self._counts[name])

    def memory(self) -> dict[str, int]:
        """Return the counts so far."""
        return dict(self._counts)


@dataclass(slots=True)
class WorkedTime:
    """Nominal seconds that the cell has moved and measured, which slow effects follow.

    Warmth, drift of the air and creep of the stand depend on work instead of the wall clock, so
    that a slow computer, a pause or a restart does not change them.
    """

    seconds: float
    """So far, over all restarts."""
