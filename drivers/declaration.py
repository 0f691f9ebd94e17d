"""What a driver is made with."""

from collections.abc import Callable
from dataclasses import dataclass

from drivers.link import never
from drivers.ports import Clock, Prompt
from drivers.stopping import Alarm, unheard
from drivers.transport import Opener
from drivers.wire.robotline import RobotLayout


@dataclass(frozen=True, slots=True, kw_only=True)
class Surroundings:
    """A device's wire, real time, the operator's wish to stop."""

    open_transport: Opener
    clock: Clock
    """Time of the device: real, or that of a simulated cell of this process."""
    cancelled: Callable[[], bool] = never
    first_number: int = 1
    """Number of the first question, 1 to 999999999: another one in each session."""
    settings: object = None
    """What a campaign says to this driver alone, whose type only that driver knows."""
    prompt: Prompt | None = None
    """Asks the operator; None without a terminal."""
    in_process: bool = False
    """Whether the device is simulated in this process."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotSurroundings(Surroundings):
    """The same of a controller."""

    layout: RobotLayout
    """Joints, coordinates and parameters of its robot."""
    alarm: Alarm = unheard
    """Shows the operator what he has to read at once."""
