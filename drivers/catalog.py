"""The drivers there are, each by the word for it in campaign.yaml: a new one needs a line here.

Only the one that is asked for is loaded.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Literal, TypeAlias, TypeVar

from drivers.declaration import ControllerDriver, TrackerDriver
from drivers.errors import AddressInvalid


def _emscon() -> TrackerDriver:
    from drivers.emscon.tracker import DRIVER

    return DRIVER


def _geocom() -> TrackerDriver:
    from drivers.geocom.tracker import DRIVER

    return DRIVER


def _robotline() -> ControllerDriver:
    from drivers.robotline.robot import DRIVER

    return DRIVER


def _linuxcnc() -> ControllerDriver:
    from drivers.linuxcnc.robot import DRIVER

    return DRIVER


TRACKERS: Mapping[str, Callable[[], TrackerDriver]] = {"emscon": _emscon, "geocom": _geocom}
CONTROLLERS: Mapping[str, Callable[[], ControllerDriver]] = {
    "robotline": _robotline,
    "linuxcnc": _linuxcnc,
}

if TYPE_CHECKING:
    TrackerName: TypeAlias = str
    ControllerName: TypeAlias = str
else:  # a choice that settings offer and check
    TrackerName, ControllerName = Literal[tuple(TRACKERS)], Literal[tuple(CONTROLLERS)]

Driver = TypeVar("Driver")


def tracker_driver(name: str) -> TrackerDriver:
    """Return a tracker's driver; raises `AddressInvalid` for one that there is not."""
    return _found("tracker", TRACKERS, name)


def controller_driver(name: str) -> ControllerDriver:
    """Return a controller's driver; raises `AddressInvalid` for one that there is not."""
    return _found("controller", CONTROLLERS, name)


def _found(device: str, drivers: Mapping[str, Callable[[], Driver]], name: str) -> Driver:
    if name not in drivers:
        raise AddressInvalid(
            f"there is no driver '{name}' for a {device}",
            remedy=f"use one of {', '.join(drivers)}, or another version of pkmcal",
        )
    return drivers[name]()
