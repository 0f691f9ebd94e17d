"""The drivers, each by the word for it in campaign.yaml: a new one needs an entry here."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivers import by_hand, pointline, robotline, watch_file
from drivers.declaration import RobotSurroundings, Surroundings
from drivers.emscon.results import recorded_measurement
from drivers.emscon.tracker import EmsconTracker
from drivers.errors import AddressInvalid
from drivers.ports import LaserTracker, RobotController
from drivers.values import Matrix3, Vector3
from drivers.wire.robotline import RobotLayout


@dataclass(frozen=True, slots=True)
class TrackerDriver:
    """Driver of a tracker."""

    make: Callable[[Surroundings], LaserTracker]
    """Make the device, not connected yet."""
    read_record: Callable[[str], tuple[Vector3, Matrix3 | None]]
    """Read point, mm, and covariance, mm², if any, from a measurement's raw answer.

    Raises `DriverError`.
    """


@dataclass(frozen=True, slots=True)
class ControllerDriver:
    """Driver of a robot's controller."""

    make: Callable[[RobotSurroundings], RobotController]
    """Make the device, not connected yet."""
    read_record: Callable[[str, RobotLayout], tuple[float, ...]]
    """Read joints, rad or mm, from a state's raw answer; raises `WireError`."""


TRACKERS: dict[str, TrackerDriver] = {
    "emscon": TrackerDriver(EmsconTracker, recorded_measurement),
    "pointline": TrackerDriver(pointline.PointlineTracker, pointline.recorded_measurement),
    "by-hand": TrackerDriver(by_hand.TrackerByHand, by_hand.recorded_measurement),
    "watch-file": TrackerDriver(watch_file.WatchedTracker, watch_file.recorded_measurement),
}
CONTROLLERS: dict[str, ControllerDriver] = {
    "robotline": ControllerDriver(robotline.LineRobot, robotline.recorded_joints),
    "by-hand": ControllerDriver(by_hand.RobotByHand, by_hand.recorded_joints),
}

if TYPE_CHECKING:
    TrackerName: TypeAlias = str
    ControllerName: TypeAlias = str
else:  # a choice that settings offer and check
    TrackerName, ControllerName = Literal[tuple(TRACKERS)], Literal[tuple(CONTROLLERS)]


def tracker_driver(name: str) -> TrackerDriver:
    """Return a tracker's driver; raises `AddressInvalid` for an unknown name."""
    if name not in TRACKERS:
        raise _unknown("tracker", name, tuple(TRACKERS))
    return TRACKERS[name]


def controller_driver(name: str) -> ControllerDriver:
    """Return a controller's driver; raises `AddressInvalid` for an unknown name."""
    if name not in CONTROLLERS:
        raise _unknown("controller", name, tuple(CONTROLLERS))
    return CONTROLLERS[name]


def _unknown(device: str, name: str, names: tuple[str, ...]) -> AddressInvalid:
    return AddressInvalid(
        f"there is no driver '{name}' for a {device}",
        remedy=f"use one of {', '.join(names)}, or another version of pkmcal",
    )
