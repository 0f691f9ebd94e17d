"""Connection to a controller that speaks robotline: numbered questions, refusals as errors."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeVar

from drivers.errors import (
    DeviceNotReady,
    DeviceRefused,
    DriverError,
    EmergencyStop,
    LimitViolation,
    MotionFault,
    WireError,
    WrongDevice,
)
from drivers.link import Link, LinkClient
from drivers.transport import Transport
from drivers.wire.robotline import (
    EMPTY_LINE,
    UNREAD_VERB,
    Refused,
    Reply,
    ReplyFramer,
    Request,
    encode_request,
)
from drivers.wire.robotline_messages import Answer, Command, RobotLayout

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


class RobotlineClient(LinkClient[Reply]):
    """Client that asks one question after another; only the last one can be answered.

    A reply to another number is stale (after a fault it can sit in a serial line's buffer): the
    link keeps it with the events, of which this protocol has none, and nobody ever reads it.
    """

    def __init__(
        self,
        transport: Transport,
        numbers: Iterator[int],
        *,
        robot: RobotLayout,
        clock_s: Callable[[], float],
        cancelled: Callable[[], bool],
    ) -> None:
        link = Link(
            transport,
            ReplyFramer(robot),
            clock_s=clock_s,
            is_event=lambda reply: reply.sequence != self._asked,
            cancelled=cancelled,
        )
        super().__init__(link)
        self._numbers = numbers
        self._asked = 0

    def ask(
        self, command: Command, kind: type[AnswerKind], within_s: float
    ) -> tuple[AnswerKind, str]:
        """Return the answer, and the line in which it came.

        Raises what a refusal means, or `LinkDown`, `WireError`, `Cancelled`; these three close.
        """
        self._asked = number = next(self._numbers)
        reply = self._link.ask(
            encode_request(Request(number, command)),
            answers=lambda reply: _is_answer(reply, number, command.verb, kind),
            within_s=within_s,
            what=command.verb,
        )
        return self._outcome(reply, command.verb, kind)

    def await_answer(
        self, blind: "BlindCommand", kind: type[AnswerKind], within_s: float
    ) -> tuple[AnswerKind, str]:
        """Return the answer to what was said blindly when this connection began; raises as `ask`.

        Nothing else has been asked since: its answer has a number that nobody asks for now, and so
        it lies among the late ones.
        """
        verb = blind.command.verb
        reply = self._link.await_event(
            lambda reply: _is_answer(reply, blind.number, verb, kind),
            within_s=within_s,
            what=verb,
        )
        return self._outcome(reply, verb, kind)

    def _outcome(self, reply: Reply, verb: str, kind: type[AnswerKind]) -> tuple[AnswerKind, str]:
        if isinstance(reply.outcome, kind):
            return reply.outcome, reply.line
        if isinstance(reply.outcome, Refused):
            raise self._refusal(reply.outcome, verb)
        raise AssertionError(reply)

    def _refusal(self, refused: Refused, verb: str) -> DriverError:
        problem = f"{self.name}: {verb} refused, {refused.code}: {refused.text}"
        if refused.code == "CHECKSUM":
            self.close()
            return WireError(problem, remedy="check the cable and its shield")
        if refused.code == "VERSION":
            return WrongDevice(problem, remedy="bring the controller's program to this version")
        error, remedy = REFUSALS.get(refused.code, OTHER_REFUSAL)
        return error(problem, remedy=remedy, code=refused.code)


@dataclass(frozen=True, slots=True)
class BlindCommand:
    """A command that is sent before anything is read, with its number."""

    number: int
    command: Command


def _is_answer(reply: Reply, number: int, verb: str, kind: type[object]) -> bool:
    if reply.sequence != number or reply.verb not in {verb, UNREAD_VERB}:
        return False
    return isinstance(reply.outcome, (kind, Refused))


def open_client(
    transport: Transport,
    numbers: Iterator[int],
    *,
    robot: RobotLayout,
    clock_s: Callable[[], float],
    cancelled: Callable[[], bool],
    blindly: BlindCommand | None = None,
    within_s: float,
) -> RobotlineClient:
    """Begin on a fresh transport; an empty line ends what an earlier client left half sent.

    A command can be sent `blindly`, before anything is read: noise on the line cannot keep it back.
    """
    opening = EMPTY_LINE
    if blindly is not None:
        opening += encode_request(Request(blindly.number, blindly.command))
    try:
        transport.send(opening, within_s)
    except DriverError:
        transport.close()
        raise
    return RobotlineClient(transport, numbers, robot=robot, clock_s=clock_s, cancelled=cancelled)
