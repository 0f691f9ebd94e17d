"""Settings of the LinuxCNC driver, and what it asks of others: kinematics, stored parameters."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from math import degrees, radians
from typing import Protocol

from drivers.errors import LimitViolation
from drivers.values import Pose

JOINTS = 4
AT_THE_LIMIT_RAD = 1e-8


class Coordinates(Enum):
    """The meaning of a move's numbers to the controller, by the letters of its axes."""

    JOINTS = "XYZA"
    WORLD = "XYZC"


@dataclass(frozen=True, slots=True)
class JointLimits:
    """The lowest and the highest angle of every joint."""

    lowest_rad: float
    highest_rad: float

    def text(self) -> str:
        """In degrees, for messages."""
        return f"{degrees(self.lowest_rad):g}° to {degrees(self.highest_rad):g}°"

    def wider_by(self, slack_rad: float) -> "JointLimits":
        """Limits of joints that only pass."""
        return JointLimits(self.lowest_rad - slack_rad, self.highest_rad + slack_rad)

    def check(self, joints: Sequence[float]) -> None:
        """Raise `LimitViolation` for a target outside, before anything is sent."""
        if len(joints) != JOINTS:
            raise LimitViolation(
                f"{len(joints)} joints were given, the robot has {JOINTS}",
                remedy="check the plan",
                code="LIMIT",
            )
        allowed = self.wider_by(AT_THE_LIMIT_RAD)
        for joint, angle_rad in enumerate(joints):
            if not allowed.lowest_rad <= angle_rad <= allowed.highest_rad:
                raise LimitViolation(
                    f"joint {joint} to {degrees(angle_rad):.4f}°, limits {self.text()}",
                    remedy="check the plan against the robot file's limits",
                    code="LIMIT",
                )


class Kinematics(Protocol):
    """A parameter set at work."""

    def joints(self, pose: Pose) -> tuple[float, ...]:
        """Encoder angles of a pose; raises `LimitViolation` for one out of reach."""
        ...

    def pose(self, joints: Sequence[float]) -> Pose:
        """Pose of encoder angles; raises `LimitViolation` where nothing can be assembled."""
        ...


KinematicsOf = Callable[[Mapping[str, float]], Kinematics]
"""Puts a parameter set, by flat name in mm and deg, to work."""


class ParameterStore(Protocol):
    """The place of the parameters that poses are converted with."""

    @property
    def needs_machine_off(self) -> bool:
        """True where writing changes what LinuxCNC itself works with."""
        ...

    def read(self) -> Mapping[str, float]:
        """All parameters by flat name, mm and deg."""
        ...

    def write(self, geometry: Mapping[str, float]) -> None:
        """Replace all of them, or raise and keep the old."""
        ...


@dataclass(frozen=True, slots=True)
class Passwords:
    """linuxcncrsh's options --connectpw and --enablepw; clear text on the wire."""

    connect: str = "EMC"
    enable: str = "EMCTOO"


@dataclass(frozen=True, slots=True)
class Patience:
    """Deadlines of LinuxCNC's answers, in real seconds."""

    greeting_s: float = 5.0
    """It opens its port a second before it answers."""
    answer_s: float = 1.0
    order_s: float = 2.0
    """Told to linuxcncrsh itself: so long it waits for the task, then the answer is NAK."""
    order_margin_s: float = 1.5


@dataclass(frozen=True, slots=True)
class SetupDeadlines:
    """Deadlines of the steps that make the machine ready, in real seconds."""

    switch_s: float = 3.0
    homing_s: float = 120.0
    poll_s: float = 0.02
    stays_on_s: float = 0.15
    """A machine with a faulty drive is seen on for a moment."""


@dataclass(frozen=True, slots=True)
class LinuxcncDeadlines:
    """All deadlines, in real seconds."""

    patience: Patience = field(default_factory=Patience)
    setup: SetupDeadlines = field(default_factory=SetupDeadlines)
    start_s: float = 1.0
    """Until an accepted move has begun or been refused."""
    frozen_s: float = 1.5
    """Until positions that stay the same in a motion are a fault."""
    stop_s: float = 8.0
    poll_s: float = 0.005


@dataclass(frozen=True, slots=True)
class LinuxcncSettings:
    """Facts about this LinuxCNC that no question can tell."""

    coordinates: Coordinates
    limits: JointLimits
    full_speed_rad_s: float
    """Of the fastest joint at a speed fraction of 1."""
    passwords: Passwords = field(default_factory=Passwords)
    passing_slack_rad: float = radians(0.5)
    """Joints may exceed their limits by so much on the way. LinuxCNC must allow it."""
    still_deg: float = 0.001
    """The largest difference between readings of a joint that stands."""
    deadlines: LinuxcncDeadlines = field(default_factory=LinuxcncDeadlines)
