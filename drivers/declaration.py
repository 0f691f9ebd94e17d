"""Declaration of a driver: how it is made, and how records of it are read without it."""

from collections.abc import Callable
from dataclasses import dataclass
from random import Random

from drivers.ports import Clock, LaserTracker, Prompt, RobotController
from drivers.stopping import Alarm
from drivers.transport import Opener
from drivers.values import Matrix3, Vector3
from drivers.wire.robotline import RobotLayout


@dataclass(frozen=True, slots=True, kw_only=True)
class Surroundings:
    """What any driver is made with: its wire, real time, the operator's wish to stop.

    `draws` is where the numbers of its questions begin: differently from session to session. `own`
    gives what a campaign says to one driver alone, whose type only that driver knows. `prompt` is
    None where nobody can be asked.
    """

    open_transport: Opener
    clock: Clock
    cancelled: Callable[[], bool]
    draws: Random
    own: Callable[[], object]
    prompt: Prompt | None = None


@dataclass(frozen=True, slots=True)
class TrackerDriver:
    """Driver of a tracker."""

    made: Callable[[Surroundings, Clock | None], LaserTracker]
    """Not connected yet. The clock is a simulated tracker's time, None for one not served here."""
    measured: Callable[[str], tuple[Vector3, Matrix3 | None]]
    """Point, mm, of a measurement's raw answer, and its covariance, mm², where it states one.

    Raises `DriverError`.
    """


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotSurroundings(Surroundings):
    """What any controller's driver is made with.

    `alarm` is told what the operator has to read at once.
    """

    layout: RobotLayout
    alarm: Alarm


@dataclass(frozen=True, slots=True)
class ControllerDriver:
    """Driver of a robot's controller."""

    made: Callable[[RobotSurroundings], RobotController]
    """Not connected yet."""
    joints: Callable[[str, RobotLayout], tuple[float, ...]]
    """Joint values of a state's raw answer, rad or mm; raises `WireError`."""
