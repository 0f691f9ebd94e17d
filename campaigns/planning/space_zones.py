"""Restricted space of a campaign: the zones that `space` in campaign.yaml names."""

import math
from collections.abc import Iterator

from campaigns.design.restricted_space import ANYWHERE, Disc, Rectangle, RestrictedSpace, Zone
from campaigns.files.wording import shown
from campaigns.settings.space import SpaceConfig, ZonesConfig


def restricted_space(config: SpaceConfig, plate_radius_mm: float) -> RestrictedSpace:
    """Space that a campaign leaves; the plate's radius is the robot's, unless the settings say."""
    own = config.plate_radius_mm
    zones = (
        *_limits(config),
        *_zones(config.keep_in, "space.keep_in", keeps_in=True),
        *_zones(config.keep_out, "space.keep_out", keeps_in=False),
    )
    return RestrictedSpace(zones, plate_radius_mm if own is None else own, config.margin_mm)


def _limits(config: SpaceConfig) -> Iterator[Zone]:
    if config.z_lowest_mm is not None:
        name = f"space.z_lowest_mm {config.z_lowest_mm:g}"
        yield Zone(name, Rectangle(), (config.z_lowest_mm, math.inf), keeps_in=True)
    if config.z_highest_mm is not None:
        name = f"space.z_highest_mm {config.z_highest_mm:g}"
        yield Zone(name, Rectangle(), (-math.inf, config.z_highest_mm), keeps_in=True)
    if config.radius_mm is not None:
        name = f"space.radius_mm {config.radius_mm:g}"
        yield Zone(name, Disc((0.0, 0.0), config.radius_mm), ANYWHERE, keeps_in=True)


def _zones(zones: ZonesConfig, key: str, *, keeps_in: bool) -> Iterator[Zone]:
    for place, box in enumerate(zones.boxes):
        area = Rectangle(box.x_mm or ANYWHERE, box.y_mm or ANYWHERE)
        name = _name(f"{key}.boxes[{place}]", box.name)
        yield Zone(name, area, box.z_mm or ANYWHERE, keeps_in)
    for place, cylinder in enumerate(zones.cylinders):
        disc = Disc(cylinder.centre_mm, cylinder.radius_mm)
        name = _name(f"{key}.cylinders[{place}]", cylinder.name)
        yield Zone(name, disc, cylinder.z_mm or ANYWHERE, keeps_in)


def _name(key: str, own: str) -> str:
    return f"{key} '{shown(own)}'" if own else key
