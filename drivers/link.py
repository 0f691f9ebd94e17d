"""Link: one question at a time over a byte pipe, with a deadline; unsolicited messages apart."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Generic, TypeVar

from drivers.errors import Cancelled, LinkDown, WireError
from drivers.transport import Transport

Message = TypeVar("Message")

EVENTS_KEPT = 1000
PATIENCE_S = 0.02
"""Duration of one wait, after which the operator's wish to stop is looked at: a signal ends no
reading, and the stop has to be on its wire within 0.1 s."""


def never() -> bool:
    """Return False: no stop is requested."""
    return False


class Link(Generic[Message]):
    """Link with one question at a time.

    A question that is not answered in time, is answered by something else, or is abandoned, closes
    the link: what arrives later must never be read as the answer to the next question.
    `feed` gives the messages that bytes complete, keeps what is incomplete and raises only
    `WireError`. `keeps` gets every event at its arrival, once: is it worth queueing?
    `clock_s` is real time, also where a simulated cell runs faster: the wire is real.
    """

    def __init__(
        self,
        transport: Transport,
        feed: Callable[[bytes], Sequence[Message]],
        *,
        clock_s: Callable[[], float],
        is_event: Callable[[Message], bool],
        keeps: Callable[[Message], bool] | None = None,
        cancelled: Callable[[], bool] = never,
    ) -> None:
        self.name = transport.name
        """Name of the device's place, for messages."""
        self._transport = transport
        self._feed = feed
        self._clock_s = clock_s
        self._is_event = is_event
        self._keeps = keeps
        self._cancelled = cancelled
        self._events: deque[Message] = deque(maxlen=EVENTS_KEPT)
        self._has_lost_events = False
        self._open = True

    @property
    def is_open(self) -> bool:
        """Whether a question can be asked."""
        return self._open

    def ask(
        self, request: bytes, *, answers: Callable[[Message], bool], within_s: float, what: str
    ) -> Message:
        """Send a question and return its answer.

        `answers` recognises the answer; `what` names the question in messages. Raises `LinkDown`,
        `WireError` or `Cancelled`, and in each case closes the link.
        """
        with self._closed_by_any_error():
            self._queue_events()
            self._raise_if_cancelled(what)
            arrivals = self._arrivals(self._clock_s() + within_s, within_s, what)
            self._transport.send(request, within_s)
            while (answer := self._sort(next(arrivals), answers)) is None:
                pass
            return answer

    def await_event(
        self, wanted: Callable[[Message], bool], *, within_s: float, what: str
    ) -> Message:
        """Return the first queued or coming event that is wanted.

        Raises like `ask`: a silence closes the link too.
        """
        with self._closed_by_any_error():
            arrivals = self._arrivals(self._clock_s() + within_s, within_s, what)
            while (found := self._take_event(wanted)) is None:
                self._sort(next(arrivals), _nothing)
            return found

    def events(self) -> list[Message]:
        """Return the unsolicited messages that came since the last call, without waiting."""
        with self._closed_by_any_error():
            self._queue_events()
        taken = list(self._events)
        self._events.clear()
        return taken

    def has_lost_events(self) -> bool:
        """Return whether events fell out of a full queue since this was last asked."""
        has_lost, self._has_lost_events = self._has_lost_events, False
        return has_lost

    def close(self) -> None:
        """Close; a second time does nothing."""
        self._open = False
        self._transport.close()

    @contextmanager
    def _closed_by_any_error(self) -> Iterator[None]:
        try:
            yield
        except WireError as error:  # the grammar does not know whose wire it reads
            self.close()
            problem = error.problem.removeprefix(f"{self.name}: ")
            raise WireError(f"{self.name}: {problem}", remedy=error.remedy) from error
        except BaseException:  # also an interrupt: the question it leaves behind may be answered
            self.close()
            raise

    def _arrivals(
        self, deadline_s: float, within_s: float, what: str
    ) -> Iterator[Sequence[Message]]:
        """Yield what arrives, piece by piece, and at the deadline raise `LinkDown`."""
        while (left_s := deadline_s - self._clock_s()) > 0.0:
            self._raise_if_cancelled(what)
            yield self._receive(min(left_s, PATIENCE_S))
        yield self._receive(0.0)  # what came in time while this process was kept from looking
        raise LinkDown(
            f"{self.name}: no answer to {what} within {within_s:g} s",
            remedy="check the device and its cable; "
            "the link was closed so that a late answer is not believed",
        )

    def _raise_if_cancelled(self, what: str) -> None:
        if self._cancelled():
            raise Cancelled(f"{self.name}: {what} was abandoned", remedy="start again when ready")

    def _receive(self, timeout_s: float) -> Sequence[Message]:
        if not self._open:
            raise LinkDown(f"{self.name}: the link is closed", remedy="connect again")
        return self._feed(self._transport.receive(timeout_s))

    def _queue_events(self) -> None:
        self._sort(self._receive(0.0), _nothing)

    def _sort(
        self, messages: Sequence[Message], answers: Callable[[Message], bool]
    ) -> Message | None:
        """Return the one answer among these; events are queued, anything else is an error."""
        answer = None
        for message in messages:
            if answer is None and answers(message):
                answer = message
            elif self._is_event(message):
                self._queue(message)
            else:
                raise WireError(f"{self.name}: answers what nobody asked: {message!r:.120}")
        return answer

    def _queue(self, event: Message) -> None:
        if self._keeps is None or self._keeps(event):
            self._has_lost_events |= len(self._events) == EVENTS_KEPT
            self._events.append(event)

    def _take_event(self, wanted: Callable[[Message], bool]) -> Message | None:
        for index, message in enumerate(self._events):
            if wanted(message):
                del self._events[index]
                return message
        return None


class LinkClient(Generic[Message]):
    """Conversation over one link: where it leads, whether it goes on, its end."""

    def __init__(self, link: Link[Message]) -> None:
        self.name = link.name
        """Name of the device's place, for messages."""
        self._link = link

    @property
    def is_open(self) -> bool:
        """Whether a question can be asked."""
        return self._link.is_open

    def close(self) -> None:
        """Free the wire, without a word; a second time does nothing."""
        self._link.close()


def _nothing(_message: object) -> bool:
    """Accept no message as an answer."""
    return False
