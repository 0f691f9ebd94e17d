"""A robot controller that speaks robotline (docs/robotline.md): units and meaning."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import degrees, isfinite, radians
from typing import TypeVar

from drivers.errors import (
    DeviceNotReady,
    DeviceRefused,
    DriverError,
    EmergencyStop,
    LimitViolation,
    LinkDown,
    MotionFault,
    RobotStateUnknown,
    WireError,
    WrongDevice,
)
from drivers.link import Link, never
from drivers.ports import Clock
from drivers.transport import Transport
from drivers.values import Identity, Pose, RobotState
from drivers.wire.robotline import (
    EMPTY_LINE,
    Refused,
    Reply,
    ReplyFramer,
    Request,
    encode_request,
    is_reply_to,
    sequence_from,
)
from drivers.wire.robotline_answers import Answer, Done, Greeting, Motion, Status
from drivers.wire.robotline_commands import (
    AXES,
    VERSION,
    Abandon,
    AskState,
    Command,
    Commit,
    Hello,
    MoveJoints,
    MovePose,
    ReadArm,
    ReadPlate,
    Stage,
    Stop,
)
from drivers.wire.robotline_geometry import (
    ARMS,
    GEOMETRY_NAMES,
    ArmGeometry,
    PlateGeometry,
    parts_of,
)

AnswerKind = TypeVar("AnswerKind", bound=Answer)

REFUSALS: Mapping[str, tuple[type[DeviceRefused], str]] = {
    "LIMIT": (LimitViolation, "compare the plan's limits with the controller's"),
    "REACH": (LimitViolation, "compare the plan's robot file with the controller's parameters"),
    "FAULT": (MotionFault, "clear the fault at the controller, then start again"),
    "ESTOP": (EmergencyStop, "release the emergency stop when it is safe, then start again"),
    "BUSY": (DeviceNotReady, "wait until the robot stands still, then try again"),
    "GEOMETRY": (DeviceRefused, "check the robot file; the controller keeps its old parameters"),
}
OTHER_REFUSAL = (DeviceRefused, "compare the controller's program with docs/robotline.md")


@dataclass(frozen=True, slots=True)
class Deadlines:
    """How long the controller may take, in real seconds."""

    answer_s: float = 2.0
    commit_s: float = 15.0
    stop_answer_s: float = 0.5
    standstill_s: float = 5.0
    poll_s: float = 0.01


class LineRobot:
    """A controller at the other end of a wire.

    Any fault of the wire closes it, and every call but `stop` raises `LinkDown` until `reconnect`.
    `clock` is real time, also for a simulated cell that runs faster: the wire is real.
    `first_sequence`, 1 to 999999999, should differ from one session to the next.
    """

    def __init__(
        self,
        open_transport: Callable[[], Transport],
        *,
        clock: Clock,
        first_sequence: int,
        deadlines: Deadlines = Deadlines(),  # noqa: B008 - frozen
        cancelled: Callable[[], bool] = never,
    ) -> None:
        self._open_transport = open_transport
        self._clock = clock
        self._numbers = sequence_from(first_sequence)
        self._deadlines = deadlines
        self._cancelled = cancelled
        self._stopping = False
        self._wire: _Conversation | None = None
        self._identity: Identity | None = None

    def connect(self) -> None:
        """Open the wire and greet; raises `LinkDown`, `WireError` or `WrongDevice`.

        From the second time on it must be the same controller that answers.
        """
        self.close()
        self._wire = self._opened()
        try:
            self._identity = self.identity()
        except DriverError:
            self.close()
            raise

    def reconnect(self) -> None:
        """Open anew after a fault. The controller has stopped, and dropped what was staged."""
        self.connect()

    def identity(self) -> Identity:
        """Ask who answers; raises `WrongDevice` when it is none of ours or not the one before."""
        identity = _identity(self._ask(Hello(VERSION), Greeting))
        if self._identity not in {None, identity}:
            raise WrongDevice(
                f"{self._name}: {identity} answers, it was {self._identity} before",
                remedy="check the address, and start again with the controller that is there",
            )
        return identity

    def state(self) -> RobotState:
        """Ask for the encoder angles as read now, and whether anything is wrong."""
        reply = self._asked().ask(AskState(), self._deadlines.answer_s)
        status = _of_kind(reply, Status)
        return RobotState(
            joints_rad=tuple(map(radians, status.joints_deg)),
            moving=status.moving,
            fault=status.fault,
            emergency_stop=status.emergency_stop,
            raw=reply.line,
        )
