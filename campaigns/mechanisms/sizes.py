"""Symmetrical robots from the sizes that people know: radii of base and platform, lengths of parts.

Only the difference of base and platform counts for a platform that keeps its direction, so a
mechanism's parameters have the platform contracted into the arms' places: P_i less b_i.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from campaigns.mechanisms.closed_chain import ClosedChain

UPRIGHT_DEG = 90.0
FIRST_OF_THREE_DEG = 0.0
FIRST_OF_FOUR_DEG = 225.0


@dataclass(frozen=True, slots=True)
class Sizes:
    """Sizes of a robot whose arms stand evenly around its base."""

    base_mm: float
    """Radius on which motors or rails stand."""
    platform_mm: float
    """Radius of the forearms' lower ends, or half of the way between the two of a part."""
    lengths_mm: Mapping[str, float]
    """Of arms and platform, by field: `arm_mm`, `forearm_mm` …"""
    first_deg: float | None = None
    """Direction of the first arm about z, if not the usual one."""


def lengths_needed(mechanism: ClosedChain) -> tuple[str, ...]:
    """Fields of `Sizes.lengths_mm` that make a robot of that mechanism."""
    space = mechanism.parameters
    fields = (*space.arm_fields, *space.platform_fields)
    return tuple(field.name for field in fields if field.quantity == "length")


def symmetrical(mechanism: ClosedChain, sizes: Sizes) -> dict[str, float]:
    """Parameters by name, mm and deg; raises `KeyError` for a length that is missing."""
    space = mechanism.parameters
    usual = FIRST_OF_FOUR_DEG if space.platform_fields else FIRST_OF_THREE_DEG
    first = usual if sizes.first_deg is None else sizes.first_deg
    flat: dict[str, float] = {}
    for arm in range(space.arms):
        direction_deg = (first + 360.0 * arm / space.arms) % 360.0
        x_mm, y_mm = _contracted_mm(math.radians(direction_deg), sizes, bool(space.platform_fields))
        on_rail = mechanism.joints[arm].unit == "mm"
        values = {
            "x_mm": x_mm,
            "y_mm": y_mm,
            "azimuth_deg": 0.0 if on_rail else direction_deg,
            "elevation_deg": UPRIGHT_DEG,
        } | dict(sizes.lengths_mm)
        for field in space.arm_fields:
            at = values[field.name] if field.quantity == "length" else values.get(field.name, 0.0)
            flat[f"arm{arm}.{field.name}"] = at
    return flat | {each.name: sizes.lengths_mm[each.name] for each in space.platform_fields}


def _contracted_mm(direction_rad: float, sizes: Sizes, of_two_parts: bool) -> tuple[float, float]:  # noqa: FBT001
    """X and y of an arm's place less those of its plate joint, seen from its part's middle."""
    x, y = math.cos(direction_rad), math.sin(direction_rad)
    aside = math.copysign(sizes.platform_mm, x) if of_two_parts else sizes.platform_mm * x
    ahead = 0.0 if of_two_parts else sizes.platform_mm * y
    return round(sizes.base_mm * x - aside, 9), round(sizes.base_mm * y - ahead, 9)
