"""Connection to a device that speaks in numbered lines: questions, and refusals as errors."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from drivers import errors
from drivers.link import Link, LinkClient
from drivers.transport import Transport
from drivers.wire import numbered_lines as lines
from drivers.wire.framing import ascii_bytes

CommandT = TypeVar("CommandT")
AnswerKind = TypeVar("AnswerKind")

Refusals = Mapping[str, tuple[type[errors.DeviceRefused], str]]
"""Error and remedy for the code of a refusal."""


@dataclass(frozen=True, slots=True)
class Dialect(Generic[CommandT]):
    """A protocol as its client speaks it; `page` says where it is specified."""

    grammar: lines.LineGrammar[CommandT, Any]
    refusals: Refusals
    page: str


class LineClient(LinkClient[lines.LineReply[Any]], Generic[CommandT]):
    """Client that asks one question after another; only the last one can be answered.

    A reply to another number is stale (after a fault it can sit in a serial line's buffer): the
    link keeps it with the events, of which these protocols have none, and nobody ever reads it.
    """

    def __init__(
        self,
        transport: Transport,
        dialect: Dialect[CommandT],
        numbers: Iterator[int],
        *,
        clock_s: Callable[[], float],
        cancelled: Callable[[], bool],
    ) -> None:
        link = Link(
            transport,
            dialect.grammar.replies(),
            clock_s=clock_s,
            is_event=lambda reply: reply.sequence != self._asked,
            cancelled=cancelled,
        )
        super().__init__(link)
        self._dialect = dialect
        self._numbers = numbers
        self._asked = 0

    def ask(
        self, command: CommandT, kind: type[AnswerKind], within_s: float
    ) -> tuple[AnswerKind, str]:
        """Return the answer, and the line in which it came.

        Raises what a refusal means, or `LinkDown`, `WireError`, `Cancelled`; these three close.
        """
        self._asked = number = next(self._numbers)
        verb = self._dialect.grammar.verb_of(command)
        reply = self._link.ask(
            self._dialect.grammar.encode_request(lines.LineRequest(number, command)),
            answers=lambda reply: _is_answer(reply, number, verb, kind),
            within_s=within_s,
            what=verb,
        )
        return self._outcome(reply, verb, kind)

    def await_answer(
        self, blind: lines.LineRequest[CommandT], kind: type[AnswerKind], within_s: float
    ) -> tuple[AnswerKind, str]:
        """Return the answer to what was said blindly when this connection began; raises as `ask`.

        Nothing else has been asked since: its answer has a number that nobody asks for now, and so
        it lies among the late ones.
        """
        verb = self._dialect.grammar.verb_of(blind.command)
        reply = self._link.await_event(
            lambda reply: _is_answer(reply, blind.sequence, verb, kind),
            within_s=within_s,
            what=verb,
        )
        return self._outcome(reply, verb, kind)

    def _outcome(
        self, reply: lines.LineReply[Any], verb: str, kind: type[AnswerKind]
    ) -> tuple[AnswerKind, str]:
        if isinstance(reply.outcome, kind):
            return reply.outcome, reply.line
        if isinstance(reply.outcome, lines.Refused):
            raise self._refusal(reply.outcome, verb)
        raise AssertionError(reply)

    def _refusal(self, refused: lines.Refused, verb: str) -> errors.DriverError:
        problem = f"{self.name}: {verb} refused, {refused.code}: {refused.text}"
        if refused.code == "CHECKSUM":
            self.close()
            return errors.WireError(problem, remedy="check the cable and its shield")
        if refused.code == "VERSION":
            return errors.WrongDevice(problem, remedy="bring the device's program to this version")
        error, remedy = self._dialect.refusals.get(
            refused.code,
            (errors.DeviceRefused, f"compare the device's program with {self._dialect.page}"),
        )
        return error(problem, remedy=remedy, code=refused.code)


def _is_answer(reply: lines.LineReply[Any], number: int, verb: str, kind: type[object]) -> bool:
    if reply.sequence != number or reply.verb not in {verb, lines.UNREAD_VERB}:
        return False
    return isinstance(reply.outcome, (kind, lines.Refused))


def open_client(
    transport: Transport,
    dialect: Dialect[CommandT],
    numbers: Iterator[int],
    *,
    clock_s: Callable[[], float],
    cancelled: Callable[[], bool],
    blindly: lines.LineRequest[CommandT] | None = None,
    within_s: float,
) -> LineClient[CommandT]:
    """Begin on a fresh transport; an empty line ends what an earlier client left half sent.

    A command can be sent `blindly`, before anything is read: noise on the line cannot keep it back.
    """
    opening = lines.EMPTY_LINE
    if blindly is not None:
        opening += dialect.grammar.encode_request(blindly)
    try:
        transport.send(opening, within_s)
    except errors.DriverError:
        transport.close()
        raise
    return LineClient(transport, dialect, numbers, clock_s=clock_s, cancelled=cancelled)


def answer_said(
    grammar: lines.LineGrammar[Any, Any], raw: str, kind: type[AnswerKind], what: str
) -> AnswerKind:
    """Answer of a line as records keep it; raises `WireError` for what is not `what`."""
    told = grammar.decode_reply(ascii_bytes(raw)).outcome
    if isinstance(told, kind):
        return told
    raise errors.WireError(f"no {what}: {raw!r:.80}")
