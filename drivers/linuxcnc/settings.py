"""Settings of the LinuxCNC driver: the machine's joints and their limits, deadlines, parameters."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from math import degrees, radians
from typing import Protocol

from drivers.errors import LimitViolation
from drivers.linuxcnc.hal_parameters import HalParameters, ParameterFile
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


class PosesOfJoints(Protocol):
    """A parameter set at work."""

    def joints(self, pose: Pose, here: Sequence[float] | None = None) -> tuple[float, ...]:
        """Joints of a pose, rad or mm, that come from `here`; raises `LimitViolation`."""

    def pose(self, joints: Sequence[float]) -> Pose:
        """Pose of joints; raises `LimitViolation` where nothing can be assembled."""


@dataclass(frozen=True, slots=True)
class LinuxcncDeadlines:
    """Deadlines of LinuxCNC, in real seconds."""

    greeting_s: float = 5.0
    """It opens its port a second before it answers."""
    answer_s: float = 0.5
    order_s: float = 2.0
    """Told to linuxcncrsh itself: so long it waits for the task, then the answer is NAK."""
    order_margin_s: float = 1.5
    switch_s: float = 3.0
    homing_s: float = 120.0
    stays_on_s: float = 0.15
    """A machine with a faulty drive is seen on for a moment."""
    setup_poll_s: float = 0.02
    start_s: float = 1.0
    """Until an accepted move has begun or been refused."""
    frozen_s: float = 1.5
    """Until positions that stay the same in a motion are a fault."""
    stop_s: float = 8.0
    stop_answer_s: float = 0.5
    """Patience of the first try to connect for a stop; each further one waits longer."""
    poll_s: float = 0.005


@dataclass(frozen=True, slots=True, kw_only=True)
class LinuxcncSettings:
    """Facts about a LinuxCNC and its robot that no question can tell; joints in rad or mm."""

    coordinates: Coordinates
    lowest: float
    highest: float
    """Limits of every joint."""
    full_speed_per_s: float
    """Of the fastest joint at a speed fraction of 1."""
    store: ParameterFile | HalParameters
    """The parameters that poses are converted with; of a controller that does it, its pins too."""
    poses_of: Callable[[Mapping[str, float]], PosesOfJoints]
    """Puts a parameter set, by flat name in mm and deg, to work."""
    robot: str = "Par4"
    joints: int = 4
    are_rotary: bool = True
    has_turn: bool = True
    """Whether the robot's plate turns."""
    connect_password: str = "EMC"  # noqa: S105 - linuxcncrsh's own default
    enable_password: str = "EMCTOO"  # noqa: S105 - linuxcncrsh's own default
    """linuxcncrsh's options --connectpw and --enablepw; clear text on the wire."""
    still: float = 0.001
    """The largest difference between readings of a joint that stands, deg or mm."""
    deadlines: LinuxcncDeadlines = field(default_factory=LinuxcncDeadlines)

    @property
    def joint_type(self) -> str:
        """Type of the joints in LinuxCNC's word."""
        return "ANGULAR" if self.are_rotary else "LINEAR"

    @property
    def letters(self) -> str:
        """Letters of the machine's axes."""
        letters: str = self.coordinates.value
        if self.coordinates is Coordinates.JOINTS:
            return letters[: self.joints]
        return letters[: POSITION + self.has_turn]

    @property
    def passing_slack(self) -> float:
        """So far may joints exceed their limits on their way: LinuxCNC must allow it."""
        return self.from_machine(PASSING_SLACK_DEG if self.are_rotary else PASSING_SLACK_MM)

    def to_machine(self, joint: float) -> float:
        """Joint in deg or mm, of one in rad or mm."""
        return degrees(joint) if self.are_rotary else joint

    def from_machine(self, joint: float) -> float:
        """Joint in rad or mm, of one as LinuxCNC tells it."""
        return radians(joint) if self.are_rotary else joint

    def limits_text(self, slack: float = 0.0) -> str:
        """Limits of joints, wider by the slack, in degrees or millimetres for messages."""
        return f"{self._text(self.lowest - slack, 'g')} to {self._text(self.highest + slack, 'g')}"

    def check(self, joints: Sequence[float], *, slack: float = 0.0) -> None:
        """Raise `LimitViolation` for a target outside, before anything is sent."""
        if len(joints) != self.joints:
            raise LimitViolation(
                f"{len(joints)} joints were given, the robot has {self.joints}",
                remedy="check the plan",
                code="LIMIT",
            )
        beyond = slack + AT_THE_LIMIT
        for number, joint in enumerate(joints):
            if not self.lowest - beyond <= joint <= self.highest + beyond:
                raise LimitViolation(
                    f"joint {number} to {self._text(joint, '.4f')}, limits {self.limits_text()}",
                    remedy="check the plan against the robot file's limits",
                    code="LIMIT",
                )

    def _text(self, joint: float, form: str) -> str:
        return f"{self.to_machine(joint):{form}}{'°' if self.are_rotary else ' mm'}"
