"""The drivers there are, each by the word for it in campaign.yaml: a new one needs a line here.

Only the one that is asked for is loaded.
"""

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivers.declaration import ControllerDriver, TrackerDriver
from drivers.errors import AddressInvalid

TRACKERS: Mapping[str, str] = {
    "emscon": "drivers.emscon.tracker",
    "pointline": "drivers.pointline.tracker",
    "by-hand": "drivers.by_hand.tracker",
    "watch-file": "drivers.watch_file.tracker",
}
CONTROLLERS: Mapping[str, str] = {
    "robotline": "drivers.robotline.robot",
    "linuxcnc": "drivers.linuxcnc.robot",
    "by-hand": "drivers.by_hand.robot",
}
"""Modules whose `DRIVER` declares it."""

if TYPE_CHECKING:
    TrackerName: TypeAlias = str
    ControllerName: TypeAlias = str
else:  # a choice that settings offer and check
    TrackerName, ControllerName = Literal[tuple(TRACKERS)], Literal[tuple(CONTROLLERS)]


def tracker_driver(name: str) -> TrackerDriver:
    """Return a tracker's driver; raises `AddressInvalid` for one that there is not."""
    found = _declared("tracker", TRACKERS, name)
    assert isinstance(found, TrackerDriver), "listed as a tracker's"
    return found


def controller_driver(name: str) -> ControllerDriver:
    """Return a controller's driver; raises `AddressInvalid` for one that there is not."""
    found = _declared("controller", CONTROLLERS, name)
    assert isinstance(found, ControllerDriver), "listed as a controller's"
    return found


def _declared(device: str, drivers: Mapping[str, str], name: str) -> object:
    if name not in drivers:
        raise AddressInvalid(
            f"there is no driver '{name}' for a {device}",
            remedy=f"use one of {', '.join(drivers)}, or another version of pkmcal",
        )
    return import_module(drivers[name]).DRIVER
