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
from dataclasses import dataclass, field, replace

import numpy as np

from campaigns.arrays import AXES, Array, Index
from campaigns.fit.slots import (
    AXIS,
    CENTRE,
    FACE,
    FIRST_PLACE,
    FRAME,
    GRAVITY,
    HEIGHT,
    LENGTH,
    PLACE,
    PLANE,
    SEAT,
    SHRINKAGE,
    TIP,
    TURN,
    SlotKind,
)
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
    """Rows (…, M, r) of values (…, M, v), one or more `Bodies` and slots (…, 1, s)."""
    columns: tuple[str, ...]
    """Columns of its values: as many as it has rows, but for what `width` says."""
    slots: tuple[SlotKind, ...]
    """Slots, in the order of the function's argument."""
    checks: tuple[str, ...] = ()
    """Quantities of which held-out observations of this kind are a test."""
    bodies: int = 1
    """Number of bodies of an observation."""
    poses: int = 1
    """Number of poses of an observation: 1, all bodies at the same one, or one for each body."""
    by_tracker: bool = False
    """Whether values are in the frame of a tracker, with its errors."""
    one_row: bool = False
    """Whether it has one row whatever the number of its values."""

    @property
    def plural(self) -> str:
        """Word for some of its observations."""
        return self.name if self.name.endswith("s") else f"{self.name}s"

    @property
    def width(self) -> int:
        """Number r of its rows."""
        return 1 if self.one_row else len(self.columns)

    @property
    def has_places(self) -> bool:
        """Whether its first three rows are places that a tracker took, which place its frame."""
        return self.by_tracker and not self.one_row

    @property
    def angles(self) -> tuple[bool, ...]:
        """Whether each of its values is an angle, deg in files, and no length."""
        return tuple(column in TURNS_DEG for column in self.columns)

    @property
    def points(self) -> tuple[slice, ...]:
        """Places among the values of the points that a tracker took."""
        starts = [n for n, column in enumerate(self.columns) if column in ("x_mm", "x2_mm")]
        return tuple(slice(start, start + 3) for start in starts if self.by_tracker)


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
    moment: Array = field(default_factory=lambda: np.zeros(0))
    """Rank of each in the order of time, points included, (M,); infinite: of the robot of today."""
    time: Array = field(default_factory=lambda: np.zeros(0))
    """Time of each in its session, from 0 to 1, (M,)."""
    warmth: Array = field(default_factory=lambda: np.zeros(0))
    """Degrees by which parts are warmer than the reference, (M,); 0 where unknown."""
    labels: tuple[str, ...] = ()
    """Names of the observations in messages; (): their numbers."""

    def __post_init__(self) -> None:
        """Fill columns left out: all of the robot of today, at the reference's temperature."""
        for name, value in (("moment", np.inf), ("time", 0.0), ("warmth", 0.0)):
            if not len(getattr(self, name)):
                object.__setattr__(self, name, np.full(len(self.values), value))

    def __len__(self) -> int:
        return len(self.values)

    def rows(self, rows: Index) -> "Block":
        """Return the block of these observations."""
        columns = ("joints", "near", "values", "stated", "frame", "moment", "time", "warmth")
        labels = [
            self.labels[place] for place in np.arange(len(self))[rows].tolist() if self.labels
        ]
        changed = {name: getattr(self, name)[rows] for name in columns}
        return replace(self, **changed, labels=tuple(labels))

    def of_today(self) -> "Block":
        """Return the block as if the robot of today were there, at the reference's temperature."""
        none = np.zeros(0)
        return replace(self, moment=none, time=none, warmth=none)

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
    by_values: Array
    """By the values, (M, r, v)."""


# One evaluation for each coordinate of all bodies, stepped into the imaginary direction.
def differentiate(
    kind: Kind, values: Array, bodies: Sequence[Bodies], slots: Array
) -> Differentiated:
    """Return the rows of values (M, v) at bodies and slots (s,), with all derivatives."""

    def stepped(at: Array, moved: Sequence[Bodies], of_slots: Array, width: int) -> Array:
        rows = np.asarray(kind.rows(at, moved, of_slots)).imag / STEP
        return np.moveaxis(np.broadcast_to(rows, (width, len(values), kind.width)), 0, -1)

    def with_body(number: int, moved: Bodies) -> list[Bodies]:
        return [*bodies[:number], moved, *bodies[number + 1 :]]

    def steps(count: int) -> Array:
        return np.asarray(1j * STEP * np.eye(count)[:, None])

    place, turn = [], []
    for number, body in enumerate(bodies):
        shifted = Bodies(np.asarray(body.place + steps(3)), body.axes)
        by_turn = np.asarray(1j * STEP * (TURNS[:, None] @ body.axes))
        turned = Bodies(body.place, np.asarray(body.axes + by_turn))
        place.append(stepped(values, with_body(number, shifted), slots[None], 3))
        turn.append(stepped(values, with_body(number, turned), slots[None], 3))
    count, size = len(slots), values.shape[1]
    return Differentiated(
        residual=np.asarray(kind.rows(values, bodies, slots[None])),
        by_place=tuple(place),
        by_turn=tuple(turn),
        by_slots=stepped(values, bodies, np.asarray(slots + steps(count)), count),
        by_values=stepped(np.asarray(values + steps(size)), bodies, slots[None], size),
    )


# --- the kinds ------------------------------------------------------------------------------------


def _length(apart: Array) -> Array:
    """Return the lengths (…, 1) of vectors (…, 3)."""
    return np.asarray(np.sqrt((apart * apart).sum(axis=-1, keepdims=True)))


def _height(values: Array, bodies: Sequence[Bodies], slots: Array) -> Array:
    """Return how far points are above the plane z = a x + b y + c, less their heights."""
    x, y, z = (bodies[0].place[..., axis : axis + 1] for axis in range(3))
    a, b, c = (slots[..., place : place + 1] for place in range(3))
    return np.asarray((z - a * x - b * y - c) / np.sqrt(1.0 + a * a + b * b) - values)


def _block(values: Array, bodies: Sequence[Bodies], slots: Array) -> Array:
    """Return how far points are above what stands on a plane, less their heights above that."""
    return _height(values, bodies, slots) - slots[..., 3:]


# Callipers measure what the nozzle drew, after the part shrank.
def _distance(values: Array, bodies: Sequence[Bodies], slots: Array) -> Array:
    """Return the distances of two points, less their shrinkage and the measured ones."""
    return np.asarray(_length(bodies[1].place - bodies[0].place) * (1.0 - slots) - values)


def _reflector(values: Array, bodies: Sequence[Bodies], slots: Array) -> Array:
    """Return the places of a reflector on its body, less the measured ones."""
    return bodies[0].point(slots) - values


def _reflectors(values: Array, bodies: Sequence[Bodies], slots: Array) -> Array:
    """Return the places of two reflectors, each on its body, less the measured ones."""
    points = [body.point(slots[..., 3 * n : 3 * n + 3]) for n, body in enumerate(bodies)]
    return np.asarray(np.concatenate(np.broadcast_arrays(*points), axis=-1) - values)


def _span(values: Array, bodies: Sequence[Bodies], slots: Array) -> Array:
    """Return the distances of a reflector at two poses, less those of the measured points."""
    apart = bodies[1].point(slots) - bodies[0].point(slots)
    return _length(apart) - _length(values[..., 3:] - values[..., :3])


# The probe's axes are the body's after a turn, which is a slot: T = R exp(ω×). Turns compare as
# rows in mm, at a lever.
def _probe(values: Array, bodies: Sequence[Bodies], slots: Array) -> Array:
    """Return the places of a probe less the measured ones, and its turn from the measured one."""
    points = bodies[0].point(slots[..., :3]) - values[..., :3]
    turned = bodies[0].axes @ matrices_of(slots[..., 3:])
    turns = turn_between(matrices_of(values[..., 3:]), turned)
    return np.concatenate(np.broadcast_arrays(points, TURN_LEVER_MM * turns), axis=-1)


def _ball_bar(values: Array, bodies: Sequence[Bodies], slots: Array) -> Array:
    """Return by how much a ball is farther from a fixed one than the bar's length, less readings.

    Slots are the fixed ball's centre, the place of the other one on its body, and the length.
    """
    apart = bodies[0].point(slots[..., 3:6]) - slots[..., :3]
    return np.asarray(_length(apart) - slots[..., 6:] - values)


def _place(values: Array, bodies: Sequence[Bodies], slots: Array) -> Array:
    """Return where points are, less where they touch a nest: at values from its seat on a plate."""
    on_plate = slots[..., 6:] + values
    turned = (matrices_of(slots[..., 3:6]) @ on_plate[..., None])[..., 0]
    return np.asarray(bodies[0].place - slots[..., :3] - turned)


# The face's normal is the gauge's axis g with slopes a and b along two directions across it:
# n = g + a u + b v. The gauge, turned with its body, meets the face at a distance along itself.
def _edge(values: Array, bodies: Sequence[Bodies], slots: Array) -> Array:
    """Return how far a gauge is pressed in by a straight edge or a face, less its readings."""
    axis, tip = slots[..., 3:6], slots[..., 6:]
    aside = np.eye(3)[np.argmin(np.abs(axis.real).reshape(-1, 3)[0])]
    u = np.cross(axis, aside)
    normal = axis + slots[..., :1] * u + slots[..., 1:2] * np.cross(axis, u)
    along = (bodies[0].axes @ axis[..., None])[..., 0]
    beyond = (bodies[0].point(tip) * normal).sum(axis=-1, keepdims=True) - slots[..., 2:3]
    return np.asarray(beyond / (along * normal).sum(axis=-1, keepdims=True) - values)


# An inclinometer turned about its x by α has its y axis raised by sin α, and one turned about its y
# has its x axis lowered.
def _inclinometer(values: Array, bodies: Sequence[Bodies], slots: Array) -> Array:
    """Return the tilts of an inclinometer about its x and y less the measured ones, at a lever."""
    up = np.concatenate([slots[..., :2], np.ones_like(slots[..., :1])], axis=-1) / np.sqrt(
        1.0 + (slots[..., :2] ** 2).sum(axis=-1, keepdims=True)
    )
    axes = bodies[0].axes @ matrices_of(slots[..., 2:])
    raised = (axes.swapaxes(-1, -2) @ up[..., None])[..., 0]
    tilts = np.arcsin(np.stack([raised[..., 1], -raised[..., 0]], axis=-1))
    return np.asarray(TURN_LEVER_MM * (tilts - values))


POINT, SECOND = (tuple(f"{axis}{of}_mm" for axis in AXES) for of in ("", "2"))
VALUE = ("value_mm",)
TURNS_DEG = ("rx_deg", "ry_deg", "rz_deg")
"""Columns of values that are angles."""
KINDS: Mapping[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("height", "height above a plane", _height, VALUE, (PLANE,), ("flat",)),
        Kind("block", "height above a block that stands on a plane", _block, VALUE,
             (PLANE, HEIGHT)),
        Kind("distance", "distance on a part that was drawn", _distance, VALUE, (SHRINKAGE,),
             ("xy",), bodies=2, poses=2),
        Kind("reflector", "point of a reflector on a part of the platform", _reflector, POINT,
             (PLACE,), ("position",), by_tracker=True),
        Kind("reflectors", "points of two reflectors at one pose", _reflectors, POINT + SECOND,
             (FIRST_PLACE, PLACE), ("position", "rotation"), bodies=2, by_tracker=True),
        Kind("span", "distance of a reflector between two poses", _span, POINT + SECOND, (PLACE,),
             ("position",), bodies=2, poses=2, by_tracker=True, one_row=True),
        Kind("probe", "pose of a probe", _probe, (*POINT, *TURNS_DEG),
             (PLACE, TURN), ("position", "rotation"), by_tracker=True),
        Kind("ball-bar", "reading of a bar from a fixed ball", _ball_bar, VALUE,
             (CENTRE, PLACE, LENGTH)),
        Kind("place", "place at a nest, seen from it", _place, POINT, (FRAME, SEAT),
             ("position",)),
        Kind("edge", "reading of a gauge along a straight edge or a face", _edge, VALUE,
             (FACE, AXIS, TIP)),
        Kind("inclinometer", "tilts of an inclinometer", _inclinometer, TURNS_DEG[:2],
             (GRAVITY, TURN)),
    )
}  # fmt: skip
"""All kinds by name."""
