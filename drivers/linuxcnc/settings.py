"""What the LinuxCNC driver is told, and what it asks of others: limits, kinematics, parameters."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import radians
from typing import Protocol

from drivers.linuxcnc.conversation import Passwords, Patience
from drivers.linuxcnc.motion import JointLimits
from drivers.linuxcnc.setup import SetupDeadlines
from drivers.linuxcnc.state import Coordinates
from drivers.values import Pose


class Kinematics(Protocol):
    """A parameter set at work."""

    def joints_rad(self, pose: Pose) -> tuple[float, ...]:
        """Encoder angles of a pose; raises `LimitViolation` for one out of reach."""
        ...

    def pose(self, joints_rad: Sequence[float]) -> Pose:
        """Pose of encoder angles; raises `LimitViolation` where nothing can be assembled."""
        ...


KinematicsOf = Callable[[Mapping[str, float]], Kinematics]
"""Puts a parameter set, by flat name in mm and deg, to work."""


class ParameterStore(Protocol):
    """Where the parameters are kept that poses are converted with."""

    @property
    def needs_machine_off(self) -> bool:
        """Whether writing changes what LinuxCNC itself works with."""
        ...

    def read(self) -> Mapping[str, float]:
        """All parameters by flat name, mm and deg."""
        ...

    def write(self, geometry: Mapping[str, float]) -> None:
        """Replace all of them, or raise and keep the old."""
        ...


@dataclass(frozen=True, slots=True)
class LinuxcncDeadlines:
    """How long things may take, in real seconds."""

    patience: Patience = field(default_factory=Patience)
    setup: SetupDeadlines = field(default_factory=SetupDeadlines)
    start_s: float = 1.0
    """Until an accepted move has begun or been refused."""
    frozen_s: float = 1.5
    """How long positions may stay the same in a motion."""
    stop_s: float = 8.0
    poll_s: float = 0.005


@dataclass(frozen=True, slots=True)
class LinuxcncSettings:
    """What no question can tell about this LinuxCNC."""

    coordinates: Coordinates
    limits: JointLimits
    full_speed_rad_s: float
    """Of the fastest joint at a speed fraction of 1."""
    passwords: Passwords = field(default_factory=Passwords)
    passing_slack_rad: float = radians(0.5)
    """By how much joints may exceed their limits on the way. LinuxCNC must allow it."""
    still_deg: float = 0.001
    """The largest difference between readings of a joint that stands."""
    deadlines: LinuxcncDeadlines = field(default_factory=LinuxcncDeadlines)
