"""Every way of a plan, from stop to stop, judged before anything moves."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from campaigns.numerics.geometry import Array, Geometry
from campaigns.numerics.paths import path_fault, route
from campaigns.numerics.placement import travel_rad
from campaigns.numerics.reach import Limits

Joints = tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Mechanism:
    """What ways are checked against."""

    geometry: Geometry
    limits: Limits
    centre: Array
    """A pose well inside the workspace, where detours may lead, (4,)."""


@dataclass(frozen=True, slots=True, eq=False)
class Stop:
    """A place on the way, and what the operator calls it."""

    name: str
    joints_rad: Array
    """(4,)"""


@dataclass(frozen=True, slots=True)
class Ways:
    """What the ways between stops come to."""

    detours: int
    """How many are not straight because that would not be safe."""
    travel_rad: float
    faults: tuple[str, ...]
    """One line for each two stops between which no safe way was found."""


def check_ways(stops: Sequence[Stop], mechanism: Mechanism) -> Ways:
    """Look for a safe way between each two stops that follow each other."""
    detours, travel, faults = 0, 0.0, []
    for here, there in pairwise(stops):
        way = safe_way(mechanism, here.joints_rad, there.joints_rad)
        if way is None:
            faults.append(_fault(mechanism, here, there))
            continue
        detours += len(way) > 1
        travel += sum(float(travel_rad(a, b)) for a, b in pairwise([here.joints_rad, *way]))
    return Ways(detours, travel, tuple(faults))


class KnownWays:
    """Safe ways, those between the stops of a plan worked out before anything moves."""

    def __init__(self, mechanism: Mechanism, stops: Sequence[Joints]) -> None:
        self._mechanism = mechanism
        self._known: dict[tuple[Joints, Joints], list[Joints]] = {}
        for here, there in pairwise(stops):
            legs = self.legs(here, there)
            if legs is not None:
                self._known[here, there] = legs

    def legs(self, here: Joints, there: Joints) -> list[Joints] | None:
        """Joint targets of a safe way, the last being `there`; None when none was found."""
        if (here, there) in self._known:
            return self._known[here, there]
        way = safe_way(self._mechanism, np.array(here), np.array(there))
        return None if way is None else [*(tuple(leg.tolist()) for leg in way[:-1]), there]


def safe_way(mechanism: Mechanism, from_rad: Array, to_rad: Array) -> list[Array] | None:
    """Joint targets (4,) of a safe way, the last being `to_rad`; None when none was found."""
    return route(mechanism.geometry, mechanism.limits, from_rad, to_rad, mechanism.centre)


def _fault(mechanism: Mechanism, here: Stop, there: Stop) -> str:
    straight = path_fault(mechanism.geometry, mechanism.limits, here.joints_rad, there.joints_rad)
    why = f"{straight.reason}, {straight.part_of_the_way:.0%} of the way" if straight else "blocked"
    return f"no safe way from {here.name} to {there.name}: {why}, and no way round"


def named_stops(names: Sequence[str], joints_rad: Array) -> list[Stop]:
    """Stops from names and joints (N, 4)."""
    return [Stop(name, np.asarray(row)) for name, row in zip(names, joints_rad, strict=True)]
