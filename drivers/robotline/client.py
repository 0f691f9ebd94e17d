"""Connection to a controller that speaks robotline: numbered questions, refusals as errors."""

from collections.abc import Callable, Iterator, Mapping
from typing import TypeVar

from drivers import errors
from drivers.link import Link, LinkClient
from drivers.transport import Transport
from drivers.wire import robotline as wire

AnswerKind = TypeVar("AnswerKind", bound=wire.Answer)

REFUSALS: Mapping[str, tuple[type[errors.DeviceRefused], str]] = {
    "LIMIT": (errors.LimitViolation, "compare the plan's limits with the controller's"),
    "REACH": (
        errors.LimitViolation,
        "compare the plan's robot file with the controller's parameters",
    ),
    "FAULT": (errors.MotionFault, "clear the fault at the controller, then start again"),
    "ESTOP": (errors.EmergencyStop, "release the emergency stop when it is safe, then start again"),
    "BUSY": (errors.DeviceNotReady, "wait until the robot stands still, then try again"),
    "GEOMETRY": (
        errors.DeviceRefused,
        "check the robot file; the controller keeps its old parameters",
    ),
}
OTHER_REFUSAL = (errors.DeviceRefused, "compare the controller's program with docs/robotline.md")


class RobotlineClient(LinkClient[wire.RobotlineReply]):
    """Client that asks one question after another; only the last one can be answered.

    A reply to another number is stale (after a fault it can sit in a serial line's buffer): the
    link keeps it with the events, of which this protocol has none, and nobody ever reads it.
    """

    def __init__(
        self,
        transport: Transport,
        numbers: Iterator[int],
        *,
        robot: wire.RobotLayout,
        clock_s: Callable[[], float],
        cancelled: Callable[[], bool],
    ) -> None:
        link = Link(
            transport,
            wire.replies(robot),
            clock_s=clock_s,
            is_event=lambda reply: reply.sequence != self._asked,
            cancelled=cancelled,
        )
        super().__init__(link)
        self._numbers = numbers
        self._asked = 0

    def ask(
        self, command: wire.Command, kind: type[AnswerKind], within_s: float
    ) -> tuple[AnswerKind, str]:
        """Return the answer, and the line in which it came.

        Raises what a refusal means, or `LinkDown`, `WireError`, `Cancelled`; these three close.
        """
        self._asked = number = next(self._numbers)
        verb = wire.verb_of(command)
        reply = self._link.ask(
            wire.encode_request(wire.RobotlineRequest(number, command)),
            answers=lambda reply: _is_answer(reply, number, verb, kind),
            within_s=within_s,
            what=verb,
        )
        return self._outcome(reply, verb, kind)

    def await_answer(
        self, blind: wire.RobotlineRequest, kind: type[AnswerKind], within_s: float
    ) -> tuple[AnswerKind, str]:
        """Return the answer to what was said blindly when this connection began; raises as `ask`.

        Nothing else has been asked since: its answer has a number that nobody asks for now, and so
        it lies among the late ones.
        """
        verb = wire.verb_of(blind.command)
        reply = self._link.await_event(
            lambda reply: _is_answer(reply, blind.sequence, verb, kind),
            within_s=within_s,
            what=verb,
        )
        return self._outcome(reply, verb, kind)

    def _outcome(
        self, reply: wire.RobotlineReply, verb: str, kind: type[AnswerKind]
    ) -> tuple[AnswerKind, str]:
        if isinstance(reply.outcome, kind):
            return reply.outcome, reply.line
        if isinstance(reply.outcome, wire.Refused):
            raise self._refusal(reply.outcome, verb)
        raise AssertionError(reply)

    def _refusal(self, refused: wire.Refused, verb: str) -> errors.DriverError:
        problem = f"{self.name}: {verb} refused, {refused.code}: {refused.text}"
        if refused.code == "CHECKSUM":
            self.close()
            return errors.WireError(problem, remedy="check the cable and its shield")
        if refused.code == "VERSION":
            return errors.WrongDevice(
                problem, remedy="bring the controller's program to this version"
            )
        error, remedy = REFUSALS.get(refused.code, OTHER_REFUSAL)
        return error(problem, remedy=remedy, code=refused.code)


def _is_answer(reply: wire.RobotlineReply, number: int, verb: str, kind: type[object]) -> bool:
    if reply.sequence != number or reply.verb not in {verb, wire.UNREAD_VERB}:
        return False
    return isinstance(reply.outcome, (kind, wire.Refused))


def open_client(
    transport: Transport,
    numbers: Iterator[int],
    *,
    robot: wire.RobotLayout,
    clock_s: Callable[[], float],
    cancelled: Callable[[], bool],
    blindly: wire.RobotlineRequest | None = None,
    within_s: float,
) -> RobotlineClient:
    """Begin on a fresh transport; an empty line ends what an earlier client left half sent.

    A command can be sent `blindly`, before anything is read: noise on the line cannot keep it back.
    """
    opening = wire.EMPTY_LINE
    if blindly is not None:
        opening += wire.encode_request(blindly)
    try:
        transport.send(opening, within_s)
    except errors.DriverError:
        transport.close()
        raise
    return RobotlineClient(transport, numbers, robot=robot, clock_s=clock_s, cancelled=cancelled)
