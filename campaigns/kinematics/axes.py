"""Axes of joints and tasks: revolute (rad inside, deg in files) or prismatic (mm)."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from campaigns.arrays import Mask

AxisKind = Literal["revolute", "prismatic"]
Interval = tuple[float, float]

MM_PER_RAD = 300.0
"""Length of a typical crank: a carriage's travel of 300 mm compares with a turn of 1 rad."""


@dataclass(frozen=True)
class Axis:
    """Joint or task coordinate by name."""

    name: str
    kind: AxisKind
    is_fixed: bool = False
    """Whether a robot in a plane never moves along it: its value is 0, and no file holds it."""

    @cached_property
    def is_revolute(self) -> bool:
        """Whether its values are angles."""
        return self.kind == "revolute"

    @property
    def unit(self) -> Literal["deg", "mm"]:
        """Unit in files and on screens."""
        return "deg" if self.is_revolute else "mm"

    @cached_property
    def column(self) -> str:
        """Name in files, with the unit: `q0_deg`."""
        return f"{self.name}_{self.unit}"

    @property
    def scale(self) -> float:
        """Travel that compares with one radian of a crank: 1 rad, or 300 mm."""
        return 1.0 if self.is_revolute else MM_PER_RAD

    def to_file(self, value: float) -> float:
        """Convert a value to the unit of files."""
        return math.degrees(value) if self.is_revolute else value

    def from_file(self, value: float) -> float:
        """Convert a value from the unit of files."""
        return math.radians(value) if self.is_revolute else value

    def text(self, value: float, form: str) -> str:
        """Write a value for people, by a format such as `.3f`: `12.345°` or `12.345 mm`."""
        return f"{self.to_file(value):{form}}{'°' if self.is_revolute else ' mm'}"

    def span(self, interval: Interval) -> str:
        """Write an interval for people: `[-45°, 90°]`."""
        low, high = (self.text(end, "g") for end in interval)
        return f"[{low}, {high}]"


POSITION = (Axis("x", "prismatic"), Axis("y", "prismatic"), Axis("z", "prismatic"))
PLANE = POSITION[:2]
"""Axes of a robot that moves in the plane of its base's x and y."""
FIXED_Z = Axis("z", "prismatic", is_fixed=True)
TURN = Axis("theta", "revolute")
TURNS = (Axis("rx", "revolute"), Axis("ry", "revolute"), Axis("rz", "revolute"))
"""Rotation vector of a platform with three turns, in the base frame."""


def outside(values: ArrayLike, interval: tuple[ArrayLike, ArrayLike]) -> Mask:
    """Return which values leave an interval, or each its own; NaN leaves none."""
    values = np.asarray(values)
    return np.asarray((values < interval[0]) | (values > interval[1]))
