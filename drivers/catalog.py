"""The drivers, each by the word for it in campaign.yaml: a new one needs an entry here."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivers import by_hand, pointline, robotline, watch_file
from drivers.declaration import RobotSurroundings, Surroundings
from drivers.emscon.results import recorded_measurement
from drivers.emscon.tracker import EmsconTracker
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


BY_HAND = "by-hand"
"""Driver and address of a device that a person works by a dialogue at the terminal."""
FILE = "file:"
"""Beginning of the address of a tracker whose software writes into a file."""

TRACKERS: dict[str, TrackerDriver] = {
    "emscon": TrackerDriver(EmsconTracker, recorded_measurement),
    "pointline": TrackerDriver(pointline.PointlineTracker, pointline.recorded_measurement),
    BY_HAND: TrackerDriver(by_hand.TrackerByHand, by_hand.recorded_measurement),
    "watch-file": TrackerDriver(watch_file.WatchedTracker, watch_file.recorded_measurement),
}
CONTROLLERS: dict[str, ControllerDriver] = {
    "robotline": ControllerDriver(robotline.LineRobot, robotline.recorded_joints),
    BY_HAND: ControllerDriver(by_hand.RobotByHand, by_hand.recorded_joints),
}
ADDRESSES = {BY_HAND: BY_HAND, "watch-file": FILE}
"""Beginning of the address of a device without a wire, by its driver."""

if TYPE_CHECKING:
    TrackerName: TypeAlias = str
    ControllerName: TypeAlias = str
else:  # a choice that settings offer and check
    TrackerName, ControllerName = Literal[tuple(TRACKERS)], Literal[tuple(CONTROLLERS)]


def driver_of_address(url: str) -> str | None:
    """Return the only driver of addresses of this form; None for those of a wire and others."""
    return next((name for name, start in ADDRESSES.items() if url.startswith(start)), None)
