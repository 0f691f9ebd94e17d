"""The drivers by their names: a new one needs an entry here, and its name in `drivers/names.py`."""

from collections.abc import Callable
from dataclasses import dataclass

from drivers import by_hand, pointline, robotline, watch_file
from drivers.declaration import RobotSurroundings, Surroundings
from drivers.emscon.results import recorded_measurement
from drivers.emscon.tracker import EmsconTracker
from drivers.names import BY_HAND, ControllerName, TrackerName
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


TRACKERS: dict[TrackerName, TrackerDriver] = {
    "emscon": TrackerDriver(EmsconTracker, recorded_measurement),
    "pointline": TrackerDriver(pointline.PointlineTracker, pointline.recorded_measurement),
    BY_HAND: TrackerDriver(by_hand.TrackerByHand, by_hand.recorded_measurement),
    "watch-file": TrackerDriver(watch_file.WatchedTracker, watch_file.recorded_measurement),
}
CONTROLLERS: dict[ControllerName, ControllerDriver] = {
    "robotline": ControllerDriver(robotline.LineRobot, robotline.recorded_joints),
    BY_HAND: ControllerDriver(by_hand.RobotByHand, by_hand.recorded_joints),
}
