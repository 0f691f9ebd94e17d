"""Restricted space (ISO 8373): where the plate may be, by zones to keep in and to keep out of.

Zones are upright: a footprint in x and y, and an interval of z, in the base frame. The plate is
an upright cylinder about the measured point, which holds it at every turn: its radius is the
plate's and the margin, its half height the margin. Clearances are those of this cylinder: 0 where
it touches a zone's wall, negative where it is in a place that is not allowed.

All shapes are convex, and their signed distances are convex functions of the point. That makes the
least clearance on a straight line simple: of a zone to keep in it is at an end, of a zone to keep
out the clearance has one minimum, which golden sections find.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array, Mask
from campaigns.kinematics.axes import Interval

ANYWHERE: Interval = (-math.inf, math.inf)
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
ROUNDING_MM = 1e-6
"""Distance beyond a wall that is rounding: places may lie on the wall itself."""
GOLDEN_SECTIONS = 48
"""Number of golden sections of a line: they narrow it to 1e-10 of its length."""


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Rectangle along x and y; without ends it covers the whole plane."""

    x_mm: Interval = ANYWHERE
    y_mm: Interval = ANYWHERE

    def distance_mm(self, points: Array) -> Array:
        """Return the distance (N,) of points (N, 2 or 3) from the edge, negative inside; convex."""
        beyond = np.stack(
            [_beyond(points[:, 0], self.x_mm), _beyond(points[:, 1], self.y_mm)], axis=-1
        )
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
        return np.asarray(outside + np.minimum(beyond.max(axis=-1), 0.0))

    def bounds_mm(self) -> tuple[Interval, Interval]:
        """Return the intervals of x and y."""
        return self.x_mm, self.y_mm


@dataclass(frozen=True, slots=True)
class Disc:
    """Disc about a vertical axis."""

    centre_mm: tuple[float, float]
    radius_mm: float

    def distance_mm(self, points: Array) -> Array:
        """Return the distance (N,) of points from the edge, negative inside; convex."""
        from_axis = np.linalg.norm(points[:, :2] - self.centre_mm, axis=1)
        return np.asarray(from_axis - self.radius_mm)

    def bounds_mm(self) -> tuple[Interval, Interval]:
        """Return the intervals of x and y that hold the disc."""
        (x, y), radius = self.centre_mm, self.radius_mm
        return (x - radius, x + radius), (y - radius, y + radius)


Footprint = Rectangle | Disc
"""Convex area in x and y."""


@dataclass(frozen=True, slots=True)
class Zone:
    """Zone to keep in, or to keep out of."""

    name: str
    """Key in campaign.yaml, with the limit or the user's own name."""
    footprint: Footprint
    z_mm: Interval
    keeps_in: bool

    def clearance_mm(self, points: Array, radius_mm: float, margin_mm: float) -> Array:
        """Return the clearance (N,) of a plate at points (N, 3): concave of a zone to keep in."""
        # kept in: the worse of both directions decides. Kept out: being clear in one is enough. A
        # largest of convex functions is convex, and its negative concave.
        aside = self.footprint.distance_mm(points)
        above = _beyond(points[:, 2], self.z_mm)
        if self.keeps_in:
            return -np.maximum(aside + radius_mm, above + margin_mm)
        return np.maximum(aside - radius_mm, above - margin_mm)


@dataclass(frozen=True, slots=True)
class RestrictedSpace:
    """Space that zones allow to the plate: all of it without zones."""

    zones: tuple[Zone, ...] = ()
    plate_radius_mm: float = 0.0
    """Radius about the measured point that holds the plate at every turn."""
    margin_mm: float = 0.0

    @property
    def is_restricted(self) -> bool:
        """Whether any place is not allowed."""
        return bool(self.zones)

    @property
    def has_obstacles(self) -> bool:
        """Whether a straight line between two allowed places may be blocked."""
        return not all(zone.keeps_in for zone in self.zones)

    def with_margin(self, more_mm: float) -> "RestrictedSpace":
        """Return this space with all walls kept off by `more_mm` more."""
        return replace(self, margin_mm=self.margin_mm + more_mm)

    def clearance_mm(self, points: Array) -> Array:
        """Return the clearance (N, Z) of a plate at points (N, 3), by zone."""
        radius_mm = self.plate_radius_mm + self.margin_mm
        columns = [zone.clearance_mm(points, radius_mm, self.margin_mm) for zone in self.zones]
        return np.stack(columns, axis=1) if columns else np.empty((len(points), 0))

    def allows(self, points: Array) -> Mask:
        """Return at which points (N, 3) a plate may be, (N,)."""
        return np.asarray((self.clearance_mm(points) >= 0.0).all(axis=1))

    # A concave clearance, of a zone to keep in, is least at an end of the line. A convex one is
    # least somewhere between. As a clearance changes by no more than the distance moved, it is
    # nowhere below (first + last - length) / 2: lines whose bound is positive are clear without a
    # search.
    def line_clearance_mm(self, starts: Array, ends: Array) -> Array:
        """Return the least clearance (N, Z) on straight lines between points (N, 3), by zone.

        Positive values may be lower bounds.
        """
        first, last = self.clearance_mm(starts), self.clearance_mm(ends)
        length = np.linalg.norm(ends - starts, axis=1)
        least = np.minimum(first, last)
        for place, zone in enumerate(self.zones):
            if zone.keeps_in:
                continue
            bound = 0.5 * (first[:, place] + last[:, place] - length)
            near = bound <= 0.0
            least[~near, place] = bound[~near]
            if not near.any():
                continue
            between = self._least_between(zone, starts[near], ends[near])
            least[near, place] = np.minimum(least[near, place], between)
        return least

    def _least_between(self, zone: Zone, starts: Array, ends: Array) -> Array:
        """Return the least convex clearance (N,) between points (N, 3)."""
        # golden section search (Press et al., Numerical Recipes), all lines at once: of two inner
        # points the one with the larger clearance becomes the new end of the interval
        along = ends - starts
        radius_mm = self.plate_radius_mm + self.margin_mm

        def at(part: Array) -> Array:
            return zone.clearance_mm(starts + part[:, None] * along, radius_mm, self.margin_mm)

        low, high = np.zeros(len(starts)), np.ones(len(starts))
        for _ in range(GOLDEN_SECTIONS):
            first, second = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
            falls = at(first) > at(second)
            low, high = np.where(falls, first, low), np.where(falls, high, second)
        return at(0.5 * (low + high))

    def fault(self, point: Array) -> str:
        """Name the zones that a plate at a point (3,) violates, with value and limit; or ""."""
        by_zone = zip(self.zones, self.clearance_mm(point[None])[0].tolist(), strict=True)
        return "; ".join(
            self._words(zone, point, clearance)
            for zone, clearance in by_zone
            if clearance < -ROUNDING_MM
        )

    def _words(self, zone: Zone, point: Array, clearance_mm: float) -> str:
        z_mm, low = float(point[2]), zone.z_mm[0]
        if zone.keeps_in and not np.isfinite(zone.footprint.bounds_mm()).any():
            side = "below" if z_mm < low + self.margin_mm else "above"
            with_margin = f" with margin_mm {self.margin_mm:g}" if self.margin_mm else ""
            return f"z {z_mm:.6g} mm is {side} {zone.name}{with_margin}"
        side = "outside" if zone.keeps_in else "too near"
        return f"the plate{self.reach_text} is {-clearance_mm:.3g} mm {side} {zone.name}"

    @property
    def reach_text(self) -> str:
        """Radius and margin about the measured point, in words; empty if both are 0."""
        parts = (("radius", self.plate_radius_mm), ("margin", self.margin_mm))
        text = " and ".join(f"{name} {size:g} mm" for name, size in parts if size)
        return f" ({text})" if text else ""


UNRESTRICTED = RestrictedSpace()


@dataclass(frozen=True, slots=True)
class Refusals:
    """Counts of poses that the robot can take but the space refuses."""

    tried: int
    """Number of all poses."""
    refused: int
    """Number of refused poses."""
    by_zone: tuple[tuple[str, int], ...]
    """Number of poses that each zone refuses, by its name: a pose may count in two zones."""


def count_refusals(space: RestrictedSpace, points: Array) -> Refusals:
    """Count the points (N, 3) that a space refuses."""
    wrong = space.clearance_mm(points) < 0.0
    counts = zip((zone.name for zone in space.zones), wrong.sum(axis=0).tolist(), strict=True)
    return Refusals(len(points), int(wrong.any(axis=1).sum()), tuple(counts))


def _beyond(values: Array, interval: Interval) -> Array:
    """Return the distance of values from an interval, negative inside; -inf if it has no ends."""
    return np.asarray(np.maximum(interval[0] - values, values - interval[1]))
