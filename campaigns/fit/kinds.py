"""Kinds of observation: how a measured value follows from where bodies of the robot are.

Theory of operation. A body is a part of the platform that carries a target, a probe or a nozzle. It
has a place and axes, a point (mm) and a rotation matrix in the frame in which the value is: the
tracker's where a tracker took it, else the base. An observation of some bodies has the rows

    r = rows(value, bodies, slots)      predicted less measured, all in mm

Slots (`slots.py`) are unknowns of the surroundings: the plane of a bed, the shrinkage of a printed
part, where a reflector or a probe sits on its body. `KINDS` is the table of these functions, each
with the slots that it takes. Derivatives by places, by small turns and by slots are complex steps,
so that they are exact to rounding. Turns of a body are small turns of its axes and not changes of a
rotation vector, which are no turns.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import AXES, Array, Index
from campaigns.fit.slots import PLACE, PLANE, SHRINKAGE, TURN, SlotKind
from campaigns.kinematics.limbs import STEP
from campaigns.kinematics.rotations import matrices_of, turn_between

TURN_LEVER_MM = 100.0
"""Distance by which turns become rows in mm: those of a point so far off the body's own."""
TURNS = -np.cross(np.eye(3)[:, None], np.eye(3))
"""Matrices (3, 3, 3) by which a small turn about x, y or z changes vectors."""


@dataclass(frozen=True, slots=True, eq=False)
class Bodies:
    """One body at M observations; arrays may be complex, with dimensions in front."""

    place: Array
    """(…, M, 3), mm."""
    axes: Array
    """Axes as the columns of matrices, (…, M, 3, 3)."""

    def point(self, place: Array) -> Array:
        """Return points (…, M, 3) at places (…, 3) on the body."""
        return np.asarray(self.place + (self.axes @ place[..., None])[..., 0])


Rows = Callable[[Array, Sequence[Bodies], Array], Array]


@dataclass(frozen=True, slots=True)
class Kind:
    """Kind of observation."""

    name: str
    words: str
    rows: Rows
    """Rows (…, M, r) of values (M, v), one or more `Bodies` and slots (…, 1, s)."""
    columns: tuple[str, ...]
    """Columns of its values: as many as it has rows."""
    slots: tuple[SlotKind, ...]
    """Slots, in the order of the function's argument."""
    checks: tuple[str, ...]
    """Quantities of which held-out observations of this kind are a test."""
    bodies: int = 1
    """Number of bodies of an observation, each at joints of its own."""
    by_tracker: bool = False
    """Whether values are in the frame of a tracker, with its errors."""


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Observations of one kind and object: M of them, of b bodies each."""

    kind: Kind
    name: str
    """What was measured: a bed, a part, a probe."""
    parts: tuple[int | None, ...]
    """Part of the platform of each body: 1 or 2 where it has two; None: what is controlled."""
    joints: Array
    """Encoder readings, (M, b, n), rad or mm."""
    near: Array
    """Poses from which the search begins, (M, b, t)."""
    values: Array
    """Measured, (M, v), mm and rad."""
    stated: Array
    """Covariance of the rows by who measured them, (M, r, r), mm²."""
    slots: tuple[str, ...]
    """Names of the slots, in the order of the kind's function."""
    frame: Index
    """Number of the frame of each observation, (M,), where a tracker took it."""

    def __len__(self) -> int:
        return len(self.values)

    def rows(self, rows: Index) -> "Block":
        """Return the block of these observations."""
        names = ("joints", "near", "values", "stated", "frame")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    @property
    def is_of_one_shot(self) -> bool:
        """Whether all bodies are at the same joints, whose scatter they share."""
        return bool((self.joints == self.joints[:, :1]).all())


@dataclass(frozen=True, slots=True, eq=False)
class Differentiated:
    """Rows with their derivatives."""

    residual: Array
    """Predicted less measured, (M, r), mm."""
    by_place: tuple[Array, ...]
    """By the place of each body, (M, r, 3)."""
    by_turn: tuple[Array, ...]
    """By a small turn of each body about the axes of its frame, (M, r, 3), mm per rad."""
    by_slots: Array
    """By the slots, (M, r, s), mm per mm, rad or ratio."""


# One evaluation for each coordinate of all bodies, stepped into the imaginary direction.
def differentiate(
    kind: Kind, values: Array, bodies: Sequence[Bodies], slots: Array
) -> Differentiated:
    """Return the rows of values (M, v) at bodies and slots (s,), with all derivatives."""

    def stepped(moved: Sequence[Bodies], at: Array, width: int) -> Array:
        rows = np.asarray(kind.rows(values, moved, at)).imag / STEP
        shape = (width, len(values), len(kind.columns))
        return np.moveaxis(np.broadcast_to(rows, shape), 0, -1)

    def with_body(number: int, moved: Bodies) -> list[Bodies]:
        return [*bodies[:number], moved, *bodies[number + 1 :]]

    step = np.asarray(1j * STEP * np.eye(3))[:, None]
    place, turn = [], []
    for number, body in enumerate(bodies):
        shifted = Bodies(np.asarray(body.place + step), body.axes)
        by_turn = np.asarray(1j * STEP * (TURNS[:, None] @ body.axes))
        turned = Bodies(body.place, np.asarray(body.axes + by_turn))
        place.append(stepped(with_body(number, shifted), slots[None], 3))
        turn.append(stepped(with_body(number, turned), slots[None], 3))
    count = len(slots)
    by_slots = stepped(bodies, np.asarray(slots + 1j * STEP * np.eye(count)[:, None]), count)
    residual = np.asarray(kind.rows(values, bodies, slots[None]))
    return Differentiated(residual, tuple(place), tuple(turn), by_slots)


# --- the kinds ------------------------------------------------------------------------------------


def _height(values: Array, bodies: Sequence[Bodies], slots: Array) -> Array:
    """Return how far points are above the plane z = a x + b y + c, less their heights."""
    x, y, z = (bodies[0].place[..., axis : axis + 1] for axis in range(3))
    a, b, c = (slots[..., place : place + 1] for place in range(3))
    return np.asarray((z - a * x - b * y - c) / np.sqrt(1.0 + a * a + b * b) - values)


# Callipers measure what the nozzle drew, after the part shrank.
def _distance(values: Array, bodies: Sequence[Bodies], slots: Array) -> Array:
    """Return the distances of two points, less their shrinkage and the measured ones."""
    apart = bodies[1].place - bodies[0].place
    length = np.sqrt((apart * apart).sum(axis=-1, keepdims=True))
    return np.asarray(length * (1.0 - slots) - values)


def _reflector(values: Array, bodies: Sequence[Bodies], slots: Array) -> Array:
    """Return the places of a reflector on its body, less the measured ones."""
    return bodies[0].point(slots) - values


# The probe's axes are the body's after a turn, which is a slot: T = R exp(ω×). Turns compare as
# rows in mm, at a lever.
def _probe(values: Array, bodies: Sequence[Bodies], slots: Array) -> Array:
    """Return the places of a probe less the measured ones, and its turn from the measured one."""
    points = bodies[0].point(slots[..., :3]) - values[:, :3]
    turned = bodies[0].axes @ matrices_of(slots[..., 3:])
    turns = turn_between(matrices_of(values[:, 3:]), turned)
    return np.concatenate(np.broadcast_arrays(points, TURN_LEVER_MM * turns), axis=-1)


POINT = tuple(f"{axis}_mm" for axis in AXES)
KINDS: Mapping[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("height", "height above a plane", _height, ("value_mm",), (PLANE,), ("flat",)),
        Kind("distance", "distance on a part that was drawn", _distance, ("value_mm",),
             (SHRINKAGE,), ("xy",), bodies=2),
        Kind("reflector", "point of a reflector on a part of the platform", _reflector, POINT,
             (PLACE,), ("position",), by_tracker=True),
        Kind("probe", "pose of a probe", _probe, (*POINT, "rx_deg", "ry_deg", "rz_deg"),
             (PLACE, TURN), ("position", "rotation"), by_tracker=True),
    )
}  # fmt: skip
"""All kinds by name."""
