"""Slots: unknowns of the surroundings, such as a bed's plane or where a probe sits on its body.

They are fitted as all other unknowns are, each with a prior: what somebody measured beforehand, or
so wide a one that it says nothing. Where nothing is known the prior's mean is where the search for
it begins, which follows from where the nominal robot was at the observations.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
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
    """1 σ of each unknown where nothing is stated of it, mm, rad or ratios; 0: as it begins."""
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


# |X|² = 2 c'X + (ρ² - |c|²) is linear in the centre c. Of points on a circle the centres on both
# sides of it are searched from too.
def _centres(points: Array) -> Array:
    """Return centres (3, 3) of spheres through points (M, 3), or near such ones."""
    middle = points.mean(axis=0)
    aside = points - middle
    square = (aside**2).sum(axis=1)
    columns = np.column_stack([2.0 * aside, np.ones(len(points))])
    centre = np.linalg.lstsq(columns, square, rcond=1e-6)[0][:3]
    normal = np.linalg.svd(aside, full_matrices=True)[2][-1]
    return np.asarray(middle + centre + np.outer([0.0, -100.0, 100.0], normal))


def _frames(points: Array) -> Array:
    """Return frames (10, 6), place and rotation vector, in the middle of points (M, 3)."""
    turns = _quarters(points)
    return np.hstack([np.tile(points.mean(axis=0), (len(turns), 1)), turns])


PLANE = SlotKind("plane", (FLAT_RAD, FLAT_RAD, FLAT_MM), _level, of_support=True)
"""Slopes a, b and height c of a plane z = a x + b y + c."""
HEIGHT = SlotKind("height", (FLAT_MM,), _zeros(1))
"""Height of an object above what it stands on."""
SHRINKAGE = SlotKind("shrinkage", (FLAT_RAD,), _zeros(1))
PLACE = SlotKind("place", (FLAT_MM,) * 3, _zeros(3))
"""Place on a body, in its axes."""
FIRST_PLACE = replace(PLACE, of_support=True)
"""Place of the first of two reflectors: the second one goes with it."""
TURN = SlotKind("turn", (FLAT_RAD,) * 3, _quarters)
"""Rotation vector from a body's axes to those of what sits on it."""
CENTRE = SlotKind("centre", (FLAT_MM,) * 3, _centres, of_support=True)
"""Centre of a fixed ball in the base frame."""
LENGTH = SlotKind("length", (FLAT_MM,), _zeros(1))
FRAME = SlotKind("frame", (FLAT_MM,) * 3 + (FLAT_RAD,) * 3, _frames, of_support=True)
"""Place and rotation vector of a plate in the base frame."""
SEAT = SlotKind("seat", (0.0,) * 3, _zeros(3))
"""Place of a nest on its plate, in the plate's axes; where none is stated, the plate's origin."""
TIP = SlotKind("tip", (0.0,) * 3, _zeros(3))
"""Place of a gauge's tip on its body; where none is stated, the controlled point."""
AXIS = SlotKind("axis", (0.0,) * 3, lambda _: np.eye(3)[2:])
"""Direction on its body in which a gauge is pressed; where none is stated, its z."""
FACE = SlotKind("face", (FLAT_RAD, FLAT_RAD, FLAT_MM), _zeros(3), of_support=True)
"""Two slopes of a face against the gauge's axis, and its place along that."""
GRAVITY = SlotKind("gravity", (FLAT_RAD,) * 2, _zeros(2), of_support=True)
"""Slopes of the vertical in the base frame: it is along (a, b, 1)."""
