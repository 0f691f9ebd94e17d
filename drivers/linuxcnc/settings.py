"""Settings of the LinuxCNC driver, and what it asks of others: kinematics, stored parameters."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from math import degrees, radians
from typing import Protocol

from drivers.errors import LimitViolation
from drivers.values import Pose

AT_THE_LIMIT = 1e-8
POSITION = 3
PASSING_SLACK_DEG = 0.5
PASSING_SLACK_MM = 5.0


class Coordinates(Enum):
    """The meaning of a move's numbers to the controller, by the letters of its axes.

    A robot of three joints, or without a turn, has the first three.
    """

    JOINTS = "XYZA"
    WORLD = "XYZC"


@dataclass(frozen=True, slots=True)
class MachineAxes:
    """Axes of a robot: how many joints, of which kind, and whether its plate turns."""

    robot: str = "Par4"
    joints: int = 4
    are_rotary: bool = True
    has_turn: bool = True

    @property
    def joint_type(self) -> str:
        """Type of the joints in LinuxCNC's word."""
        return "ANGULAR" if self.are_rotary else "LINEAR"

    @property
    def joint_word(self) -> str:
        """Type of the joints for people."""
        return "rotary" if self.are_rotary else "linear"

    def letters(self, coordinates: Coordinates) -> str:
        """Letters of the machine's axes in such coordinates."""
        letters: str = coordinates.value
        if coordinates is Coordinates.JOINTS:
            return letters[: self.joints]
        return letters[: POSITION + self.has_turn]

    def to_machine(self, joint: float) -> float:
        """Joint in deg or mm, of one in rad or mm."""
        return degrees(joint) if self.are_rotary else joint

    def from_machine(self, joint: float) -> float:
        """Joint in rad or mm, of one as LinuxCNC tells it."""
        return radians(joint) if self.are_rotary else joint

    def text(self, joint: float, form: str) -> str:
        """Joint for people: `12.345°` or `12.345 mm`."""
        return f"{self.to_machine(joint):{form}}{'°' if self.are_rotary else ' mm'}"


@dataclass(frozen=True, slots=True)
class JointLimits:
    """The lowest and the highest place of every joint, rad or mm."""

    lowest: float
    highest: float
    axes: MachineAxes = MachineAxes()

    def text(self) -> str:
        """In degrees or millimetres, for messages."""
        return f"{self.axes.text(self.lowest, 'g')} to {self.axes.text(self.highest, 'g')}"

    def wider_by(self, slack: float) -> "JointLimits":
        """Limits of joints that only pass."""
        return replace(self, lowest=self.lowest - slack, highest=self.highest + slack)

    def check(self, joints: Sequence[float]) -> None:
        """Raise `LimitViolation` for a target outside, before anything is sent."""
        if len(joints) != self.axes.joints:
            raise LimitViolation(
                f"{len(joints)} joints were given, the robot has {self.axes.joints}",
                remedy="check the plan",
                code="LIMIT",
            )
        allowed = self.wider_by(AT_THE_LIMIT)
        for number, joint in enumerate(joints):
            if not allowed.lowest <= joint <= allowed.highest:
                raise LimitViolation(
                    f"joint {number} to {self.axes.text(joint, '.4f')}, limits {self.text()}",
                    remedy="check the plan against the robot file's limits",
                    code="LIMIT",
                )


class Kinematics(Protocol):
    """A parameter set at work."""

    def joints(self, pose: Pose) -> tuple[float, ...]:
        """Joints of a pose, rad or mm; raises `LimitViolation` for one out of reach."""
        ...

    def pose(self, joints: Sequence[float]) -> Pose:
        """Pose of joints; raises `LimitViolation` where nothing can be assembled."""
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
    stop_answer_s: float = 0.5
    """Patience of the first try to connect for a stop; each further one waits longer."""
    poll_s: float = 0.005


@dataclass(frozen=True, slots=True)
class LinuxcncSettings:
    """Facts about this LinuxCNC that no question can tell."""

    coordinates: Coordinates
    limits: JointLimits
    full_speed_per_s: float
    """Of the fastest joint at a speed fraction of 1, rad/s or mm/s."""
    passwords: Passwords = field(default_factory=Passwords)
    still: float = 0.001
    """The largest difference between readings of a joint that stands, deg or mm."""
    deadlines: LinuxcncDeadlines = field(default_factory=LinuxcncDeadlines)

    @property
    def axes(self) -> MachineAxes:
        """Axes of the robot."""
        return self.limits.axes

    @property
    def letters(self) -> str:
        """Letters of the machine's axes."""
        return self.axes.letters(self.coordinates)

    @property
    def passing(self) -> JointLimits:
        """Limits of joints on their way, which may exceed the others: LinuxCNC must allow it."""
        slack = PASSING_SLACK_DEG if self.axes.are_rotary else PASSING_SLACK_MM
        return self.limits.wider_by(self.axes.from_machine(slack))
