"""Surroundings: everything that a driver is created with.

How a driver is added (CONTRIBUTING.md, Adding a protocol):

1. Its grammar in `drivers/wire/`, if it speaks over a wire: messages to bytes and back, no I/O.
2. Its device in `drivers/`: a class with one of the two ports of `drivers/ports.py`, which takes
   `Surroundings`, a controller's `RobotSurroundings`. It connects only when it is asked to.
3. A function that reads a raw answer again, as the journal keeps it.
4. One entry in `drivers/catalog.py`, and its name in campaign.yaml in `drivers/names.py`.

A driver gets its transport, time, wish to stop and first number from outside, and so it runs
unchanged over a real wire, in a simulated cell of this process, and on a clock moved by a test.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from drivers.link import never
from drivers.ports import Clock, Prompt
from drivers.stopping import Alarm, unheard
from drivers.transport import Opener
from drivers.wire.robotline import RobotLayout

Settings = TypeVar("Settings")


@dataclass(frozen=True, slots=True, kw_only=True)
class Surroundings:
    """Wire, clock, wish to stop and settings of one device."""

    open_transport: Opener
    clock: Clock
    """Time of the device: real, or that of a simulated cell of this process."""
    cancelled: Callable[[], bool] = never
    """Returns whether the operator wants to stop."""
    # A run that follows another would use its numbers again, and could take an old answer that
    # still lies in a serial line's buffer for its own.
    first_number: int = 1
    """Number of the first question, 1 to 999999999: another one in each session."""
    settings: object = None
    """Settings of this driver alone, in a type of its own module; None if it has none."""
    prompt: Prompt | None = None
    """Question to the operator; None without a terminal."""
    announce: Callable[[str], None] = unheard
    """Message to the operator on what to do now, to which there is no answer."""
    in_process: bool = False
    """Whether the device is simulated in this process."""

    def settings_as(self, kind: type[Settings]) -> Settings:
        """Return the settings, which the campaign makes in the type that the driver needs."""
        assert isinstance(self.settings, kind), "the campaign has them for this driver"
        return self.settings


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotSurroundings(Surroundings):
    """Surroundings of a robot's controller."""

    layout: RobotLayout
    """Joints, coordinates and parameters of its robot."""
    alarm: Alarm = unheard
    """Message that the operator has to read at once."""
