"""Slots: unknowns of the surroundings, such as a bed's plane or where a probe sits on its body.

They are fitted as all other unknowns are, each with a prior: what somebody measured beforehand, or
so wide a one that it says nothing. Where nothing is known the prior's mean is where the search for
it begins, which follows from where the nominal robot was at the observations.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from campaigns.arrays import Array
from campaigns.fit.effects import Effect, Moved

if TYPE_CHECKING:
    from campaigns.fit.error_model import Observations

FLAT_MM, FLAT_RAD = 1e3, 1.0
"""1 σ of slots of which nothing is known: of lengths, and of slopes, turns and ratios."""


@dataclass(frozen=True, slots=True)
class Slot(Effect):
    """Unknown of the surroundings with its prior; it moves no point of the robot."""

    object: str
    """What it belongs to: a bed, a part, a probe."""
    what: str
    """What it is of it: its plane, its shrinkage, its place."""
    start: tuple[float, ...]
    """Mean of the prior, mm, rad or ratios."""
    std: tuple[float, ...]
    """1 σ of the prior; unknowns are deviations from its mean in σ."""
    source: ClassVar[str] = "surroundings"

    @property
    def moves(self) -> Moved:
        """What it would move."""
        return "point"

    @property
    def name(self) -> str:
        """Name among all effects."""
        return f"{self.what} of {self.object}"

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return len(self.start)

    def basis(self, observations: "Observations") -> Array:
        """Return the motions of points by each unknown, (N, 3, k): none."""
        return np.zeros((len(observations), 3, self.count))

    # A prior that somebody measured is its size already.
    @property
    def sizes_of(self) -> tuple[tuple[str, int], ...]:
        """Groups of unknowns with a size of their own: none."""
        return (("", self.count),)

    def values(self, z: Array) -> Array:
        """Return its values (k,) at unknowns z (k,), mm, rad or ratios."""
        return np.asarray(self.start + np.array(self.std) * z)


@dataclass(frozen=True, slots=True)
class SlotKind:
    """Kind of unknowns of the surroundings, as the function of a kind of observation takes them."""

    name: str
    flat: tuple[float, ...]
    """1 σ of each unknown where nothing is known of it, mm, rad or ratios."""
    begins: Callable[[Array], Array]
    """Values (k, s) from which it is searched, by the nominal points (M, 3) of the observations."""
    of_support: bool = False
    """Whether it belongs to what the object stands on, if it stands on anything."""


def _level(points: Array) -> Array:
    """Return the level plane (1, 3) through the middle of points (M, 3)."""
    return np.array([[0.0, 0.0, points[:, 2].mean()]])


def _zeros(count: int) -> Callable[[Array], Array]:
    """Return a search of so many unknowns that begins at 0."""
    return lambda _: np.zeros((1, count))


# Turns by a quarter about three axes: from one of them every turn is less than 63° away.
def _quarters(_: Array) -> Array:
    """Return rotation vectors (10, 3), rad."""
    quarters = [sign * axis for axis in 0.5 * np.pi * np.eye(3) for sign in (-1.0, 1.0)]
    return np.array([np.zeros(3), *quarters, *(np.pi * np.eye(3))])


PLANE = SlotKind("plane", (FLAT_RAD, FLAT_RAD, FLAT_MM), _level, of_support=True)
"""Slopes a, b and height c of a plane z = a x + b y + c."""
SHRINKAGE = SlotKind("shrinkage", (FLAT_RAD,), _zeros(1))
PLACE = SlotKind("place", (FLAT_MM,) * 3, _zeros(3))
"""Place on a body, in its axes."""
TURN = SlotKind("turn", (FLAT_RAD,) * 3, _quarters)
"""Rotation vector from a body's axes to those of what sits on it."""
