"""Client of a device that speaks in numbered lines: questions, and refusals as errors.

robotline and pointline share it (docs/reference/robotline.md, Lines). A question has a number and a
verb, which its answer repeats. On a serial line bytes outlive a connection in buffers, so that
closing the link is not enough there: an answer is taken only if number, verb and kind of body fit.

1. A new connection begins with an empty line, which ends what an earlier client left half sent.
2. `ask` sends the next number. A line with another number is an old answer, and is passed over.
3. A line with this number but another verb or body, or one that cannot be read, closes the link.
4. `NO` and a code become the error that the dialect has for this code, with its remedy.

Numbers go on over reconnections, and each session begins with another one (`Surroundings`), so that
an answer to an earlier program is not taken for ours.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeVar

from drivers import errors
from drivers.link import Link, LinkClient
from drivers.transport import Transport
from drivers.values import Identity
from drivers.wire.framing import ascii_bytes
from drivers.wire.lines import (
    EMPTY_LINE,
    UNREAD_VERB,
    Answer,
    Greeting,
    LineGrammar,
    Nothing,
    Question,
    Refused,
)

Body = TypeVar("Body")
NOTHING = Nothing()


@dataclass(frozen=True, slots=True)
class Dialect:
    """A protocol as its client speaks it: error and remedy for the code of each refusal.

    `page` specifies it; an answer is waited for `answer_s`, if nothing else is said.
    """

    grammar: LineGrammar
    refusals: Mapping[str, tuple[type[errors.DeviceRefused], str]]
    page: str
    answer_s: float


class LineClient(LinkClient[Answer]):
    """Client that asks one question after another; only the last one can be answered.

    `numbers` are those of its questions. The verb `first`, such as STOP, is sent before anything is
    read, so that noise on the line cannot keep it back.
    """

    def __init__(
        self,
        transport: Transport,
        dialect: Dialect,
        numbers: Iterator[int],
        *,
        clock_s: Callable[[], float],
        cancelled: Callable[[], bool],
        first: str = "",
    ) -> None:
        link = Link(
            transport,
            dialect.grammar.answer_reader(),
            clock_s=clock_s,
            # These protocols have no events. An old answer is queued as one, and no one reads it.
            is_event=lambda answer: answer.number != self._asked,
            cancelled=cancelled,
        )
        super().__init__(link)
        self.latest_line = ""
        """Line of the latest answer, as records keep it."""
        self._dialect = dialect
        self._numbers = numbers
        # Number of the latest question; no question has number 0.
        self._asked = 0
        self._first = Question(next(numbers), first) if first else None
        opening = EMPTY_LINE
        if self._first is not None:
            opening += dialect.grammar.encode_question(self._first)
        try:
            transport.send(opening, dialect.answer_s)
        except BaseException:  # also an interrupt
            transport.close()
            raise

    def ask(
        self, verb: str, kind: type[Body], body: object = NOTHING, *, within_s: float | None = None
    ) -> Body:
        """Return the answer to a question.

        Raises what a refusal means, or `LinkDown`, `WireError`, `Cancelled`; these three close.
        """
        question = Question(next(self._numbers), verb, body)
        self._asked = question.number
        answer = self._link.ask(
            self._dialect.grammar.encode_question(question),
            answers=lambda answer: _is_answer(answer, question, kind),
            within_s=within_s or self._dialect.answer_s,
            title=verb,
        )
        return self._body_of(answer, verb, kind)

    def await_first(self, kind: type[Body], within_s: float) -> Body:
        """Return the answer to the verb that was sent first; raises as `ask`.

        It must come before any other question is asked.
        """
        first = self._first
        assert first is not None, "a verb was sent first"
        # `_asked` is still 0, so that the link takes this answer too for an event.
        answer = self._link.await_event(
            lambda answer: _is_answer(answer, first, kind), within_s=within_s, title=first.verb
        )
        return self._body_of(answer, first.verb, kind)

    def _body_of(self, answer: Answer, verb: str, kind: type[Body]) -> Body:
        if isinstance(answer.body, Refused):
            raise self._refusal(answer.body, verb)
        assert isinstance(answer.body, kind), "only such an answer was accepted"
        self.latest_line = answer.line
        return answer.body

    def _refusal(self, refused: Refused, verb: str) -> errors.DriverError:
        problem = f"{self.name}: {verb} refused, {refused.code}: {refused.text}"
        # The device has read a damaged question. What else it has read is unknown: the link ends.
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


def _is_answer(answer: Answer, question: Question, kind: type[object]) -> bool:
    # A device that could not read the verb of a damaged line puts `?` in its place.
    return (
        answer.number == question.number
        and answer.verb in {question.verb, UNREAD_VERB}
        and isinstance(answer.body, (kind, Refused))
    )


def identity_of(greeting: Greeting, protocol: str) -> Identity:
    """Return who has greeted in a protocol such as `pointline`."""
    return Identity(
        vendor=greeting.vendor,
        model=greeting.model,
        serial=greeting.serial,
        firmware=greeting.firmware,
        protocol=f"{protocol} {greeting.version}",
    )


def recorded_answer(grammar: LineGrammar, line: str, kind: type[Body]) -> Body:
    """Read an answer from a line as records keep it; raises `WireError` for another one."""
    body = grammar.decode_answer(ascii_bytes(line)).body
    if isinstance(body, kind):
        return body
    raise errors.WireError(f"not a line of {kind.__name__}: {line!r:.80}")
