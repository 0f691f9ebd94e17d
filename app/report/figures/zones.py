"""Zones of a restricted space, drawn beside poses: to keep out of filled, to keep in dashed."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from app.report.figures.picture import INK, QUIET
from campaigns.arrays import Array
from campaigns.design.restricted_space import Disc, RestrictedSpace, Zone

ROOM = 0.1
"""Beyond the reach of the plate, in the extent of the poses."""
CORNERS = 48
"""Of a circle."""
UPRIGHTS = 4
OUT, IN = "keep out", "keep in"


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """Zone as far as the picture goes."""

    keeps_in: bool
    edge: Array
    """Edge of its footprint, closed, (K, 2)."""
    z_mm: tuple[float, float]
    seen_from_above: bool

    @property
    def loops(self) -> tuple[Array, Array]:
        """Lower and upper edge, (K, 3)."""
        low, high = (np.column_stack([self.edge, np.full(len(self.edge), z)]) for z in self.z_mm)
        return low, high


def outlines(space: RestrictedSpace, points: Array) -> tuple[Outline, ...]:
    """Zones as far as they are near points (N, 3)."""
    extent = max(float(np.ptp(points, axis=0).max()), 1.0)
    room = space.plate_radius_mm + space.margin_mm + ROOM * extent
    low, high = points.min(axis=0) - room, points.max(axis=0) + room
    found = (_outline(zone, low, high) for zone in space.zones)
    return tuple(each for each in found if each is not None)


def draw_zones(space: Any, above: Axes, zones: tuple[Outline, ...]) -> None:
    """Draw them in space and from above."""
    for keeps_in, name, line in ((False, OUT, "-"), (True, IN, "--")):
        colour = QUIET if keeps_in else INK
        chosen = [zone for zone in zones if zone.keeps_in is keeps_in]
        for zone in chosen:
            lower, upper = zone.loops
            steps = range(0, len(lower) - 1, max(1, (len(lower) - 1) // UPRIGHTS))
            for part in (lower, upper, *(np.stack([lower[at], upper[at]]) for at in steps)):
                space.plot(*part.T, line, color=colour, linewidth=0.7, zorder=1.2)
        for zone in filter(lambda each: each.seen_from_above, chosen):
            above.plot(*zone.edge.T, line, color=colour, linewidth=0.9, zorder=1.2)
            if not keeps_in:
                above.fill(*zone.edge.T, color=INK, alpha=0.12, linewidth=0.0, zorder=1.1)
        if chosen:
            above.plot([], [], line, color=colour, linewidth=0.9, label=name)


def _outline(zone: Zone, low: Array, high: Array) -> Outline | None:
    """Zone within the corners (3,) of the picture; None outside of it."""
    ends = np.array([*zone.footprint.bounds_mm(), zone.z_mm])
    lowest, highest = np.maximum(ends[:, 0], low), np.minimum(ends[:, 1], high)
    if (lowest >= highest).any():
        return None
    (x0, y0, z0), (x1, y1, z1) = lowest.tolist(), highest.tolist()
    edge = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])
    if isinstance(zone.footprint, Disc):
        turn = np.linspace(0.0, 2.0 * np.pi, CORNERS + 1)
        around = np.column_stack([np.cos(turn), np.sin(turn)])
        edge = np.clip(
            zone.footprint.centre_mm + zone.footprint.radius_mm * around, low[:2], high[:2]
        )
    return Outline(zone.keeps_in, edge, (z0, z1), bool(np.isfinite(ends[:2]).any()))
