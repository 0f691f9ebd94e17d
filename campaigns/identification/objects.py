"""Objects: what was measured besides the robot, and what is known of it beforehand.

A bed, a block that stands on it, a printed part, a reflector or a probe on the platform. What is
stated of an object is the prior of its unknowns in the fit; what is not stated is fitted freely.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from campaigns.errors import OptionsInvalid
from campaigns.files.wording import suggestion

Stated = tuple[tuple[float, ...], tuple[float, ...]]
"""Values of unknowns and 1 σ of each."""
DEG = np.pi / 180.0
PARTS: Mapping[str | None, int | None] = {None: None, "tool": None, "half 1": 1, "half 2": 2}
"""Parts of the platform that carry an object, by word; None: the controlled point."""


@dataclass(frozen=True, slots=True)
class Object:
    """Thing that observations are of."""

    name: str
    body: str | None = None
    """Part of the platform that carries it: "tool", the controlled point; "half 1" or "half 2"."""
    on: "str | Object | None" = None
    """What it stands on or belongs to: a block's bed, a nest's plate, a gauge's edge, a bar's fixed
    ball, the first of two reflectors."""
    place_mm: tuple[float, float, float] | None = None
    """Place on its part of the platform, or on what it stands on."""
    std_mm: float | None = None
    """1 σ of its place, height and length."""
    turn_deg: tuple[float, float, float] | None = None
    """Rotation vector of its axes, seen from those of what carries it."""
    turn_std_deg: float | None = None
    """1 σ of its turn, or of its axis."""
    axis: tuple[float, float, float] | None = None
    """Direction on its part of the platform in which a gauge is pressed; None: its z."""
    shrinkage_percent: float = 0.0
    """Shrinkage of what was drawn."""
    shrinkage_std_percent: float | None = None
    """1 σ of the shrinkage; None: nothing is known of it."""
    height_mm: float | None = None
    length_mm: float | None = None
    length_std_mm: float | None = None
    """1 σ of its length, if it is not that of its place."""

    @property
    def part(self) -> int | None:
        """Number of the part of the platform that carries it; None: the controlled point."""
        if self.body not in PARTS:
            words = tuple(word for word in PARTS if word is not None)
            raise OptionsInvalid(
                f"{self.name}: '{self.body}' is no part of a platform",
                remedy=suggestion(str(self.body), words),
            )
        return PARTS[self.body]

    @property
    def support(self) -> "Object":
        """What it stands on: itself if it stands on nothing."""
        if self.on is None:
            return self
        return Object(self.on) if isinstance(self.on, str) else self.on

    def stated(self, what: str) -> Stated | None:
        """Return what is stated of its place, turn, …: values and 1 σ in mm, rad or ratios.

        None: nothing is. Raise `OptionsInvalid` for a value without its σ.
        """
        place, turn = (self.place_mm, self.std_mm, 1.0), (self.turn_deg, self.turn_std_deg, DEG)
        if what in {"place", "tip"} or (what == "seat" and self.on is not None):
            return self._checked(what, *place)
        if what == "turn":
            return self._checked(what, *turn)
        if what == "frame" and self.place_mm is not None and self.turn_deg is not None:
            parts = [self.stated(part) or ((), ()) for part in ("place", "turn")]
            return parts[0][0] + parts[1][0], parts[0][1] + parts[1][1]
        if what == "axis" and self.axis is not None:
            unit = np.array(self.axis) / np.linalg.norm(self.axis)
            return self._checked(what, tuple(unit.tolist()), DEG * (self.turn_std_deg or 0.0), 1.0)
        if what == "height":
            return self._checked(what, _single(self.height_mm), self.std_mm, 1.0)
        if what == "length":
            std = self.std_mm if self.length_std_mm is None else self.length_std_mm
            return self._checked(what, _single(self.length_mm), std, 1.0)
        if what == "shrinkage" and self.shrinkage_std_percent is not None:
            shrinkage = _single(self.shrinkage_percent)
            return self._checked(what, shrinkage, self.shrinkage_std_percent, 0.01)
        return None

    def _checked(
        self, what: str, value: tuple[float, ...] | None, std: float | None, unit: float
    ) -> Stated | None:
        """Return values and their σ, each in units that are so many mm, rad or ratios."""
        if value is None:
            return None
        if std is None or not (np.isfinite([*value, std]).all() and std >= 0.0):
            raise OptionsInvalid(
                f"{self.name}: {what} {value} with a 1 σ of {std}, must be numbers",
                remedy=f"state how well its {what} is known, or leave both out",
            )
        return tuple(unit * v for v in value), (unit * std,) * len(value)


def _single(value: float | None) -> tuple[float, ...] | None:
    """Return a value as that of one unknown."""
    return None if value is None else (value,)


def with_supports(objects: Iterable[Object]) -> Iterator[Object]:
    """Yield objects and what they stand on; of what is only named, and not among them, the name."""
    given = [part for thing in objects for part in (thing, thing.on) if isinstance(part, Object)]
    yield from given
    names = {thing.name for thing in given}
    yield from (Object(t.on) for t in given if isinstance(t.on, str) and t.on not in names)


def linked(objects: Iterable[Object]) -> dict[str, Object]:
    """Return objects by name, what they stand on as objects too.

    Raise `OptionsInvalid` for two of one name, or one that stands on none of these.
    """
    by_name: dict[str, Object] = {}
    for thing in objects:
        if by_name.setdefault(thing.name, thing) != thing:
            raise OptionsInvalid(
                f"two objects are called '{thing.name}'", remedy="give each a name of its own"
            )
    for name, thing in by_name.items():
        if isinstance(thing.on, str):
            if thing.on not in by_name or thing.on == name:
                raise OptionsInvalid(
                    f"{name} stands on '{thing.on}', which is no other object",
                    remedy=suggestion(thing.on, tuple(by_name)),
                )
            by_name[name] = replace(thing, on=by_name[thing.on])
    return by_name
