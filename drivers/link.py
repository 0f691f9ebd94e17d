"""Link: one question at a time over a byte pipe, with a deadline; unsolicited messages apart.

An answer that comes late is worse than none. If it is read as the answer to the next question, each
point of a campaign belongs to the pose before, and every number looks right (docs/adr, 5). A link
therefore takes as an answer only what comes while its question is open:

1. Read what has already arrived. Events are queued; anything else is an error.
2. Send the question, and read until its answer is whole or its deadline has passed.
3. Sort each message: the answer, an event for the queue, or an error.
4. Close the transport after silence, an error, a wish to stop or an interrupt. What arrives later
   meets a closed connection; a session (`drivers/session.py`) opens a new one.

Events are recognised by marks of the protocol (`is_event`), never by their time. They wait in a
queue of bounded length until `events` or `await_event` takes them.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Generic, TypeVar

from drivers.errors import Cancelled, LinkDown, WireError
from drivers.transport import Transport

Message = TypeVar("Message")

EVENTS_KEPT = 1000
# A signal ends no reading, and a stop has to be on its wire within 0.1 s: waits are this short.
PATIENCE_S = 0.02
"""Duration of one wait, after which the operator's wish to stop is looked at."""


def never() -> bool:
    """Return False: no stop is requested."""
    return False


class Link(Generic[Message]):
    """Link with one question at a time.

    A question that is not answered in time, is answered by something else, or is abandoned, closes
    the link. `feed` returns the messages that bytes complete, keeps what is incomplete and raises
    only `WireError`. `keeps` gets every event once, at its arrival: is it to be queued?
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
        self, request: bytes, *, answers: Callable[[Message], bool], within_s: float, title: str
    ) -> Message:
        """Send a question and return its answer.

        `answers` recognises the answer; `title` names the question in messages. Raises `LinkDown`,
        `WireError` or `Cancelled`, and in each case closes the link.
        """
        with self._closed_by_any_error():
            # Whatever is here before the question is sent cannot be its answer.
            self._queue_events()
            self._raise_if_cancelled(title)
            # The deadline counts from before the sending, and no byte or event puts it off.
            arrivals = self._arrivals(self._clock_s() + within_s, within_s, title)
            self._transport.send(request, within_s)
            while (answer := self._sort(next(arrivals), answers)) is None:
                pass  # `_arrivals` raises at the deadline
            return answer

    def await_event(
        self, wanted: Callable[[Message], bool], *, within_s: float, title: str
    ) -> Message:
        """Return the first queued or coming event that is wanted.

        Raise like `ask`: a silence closes the link too.
        """
        with self._closed_by_any_error():
            arrivals = self._arrivals(self._clock_s() + within_s, within_s, title)
            # The queue first: a tracker's result may come before the answer that starts it.
            while (event := self._take_event(wanted)) is None:
                self._sort(next(arrivals), _accept_no_answer)
            return event

    def events(self) -> list[Message]:
        """Return the unsolicited messages that came since the last call, without waiting."""
        with self._closed_by_any_error():
            self._queue_events()
        taken = list(self._events)
        self._events.clear()
        return taken

    def take_lost_events(self) -> bool:
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
        except BaseException:  # also an interrupt: its question stays open and may be answered
            self.close()
            raise

    def _arrivals(
        self, deadline_s: float, within_s: float, title: str
    ) -> Iterator[Sequence[Message]]:
        """Yield what arrives, piece by piece, and at the deadline raise `LinkDown`."""
        while (remaining_s := deadline_s - self._clock_s()) > 0.0:
            self._raise_if_cancelled(title)
            yield self._receive(min(remaining_s, PATIENCE_S))
        # A busy computer may wake this process after the deadline only. What lies in the buffer by
        # then counts: the device is not to blame.
        yield self._receive(0.0)
        raise LinkDown(
            f"{self.name}: no answer to {title} within {within_s:g} s",
            remedy="check the device and its cable; "
            "the link was closed so that a late answer is not believed",
        )

    def _raise_if_cancelled(self, title: str) -> None:
        if self._cancelled():
            raise Cancelled(f"{self.name}: {title} was abandoned", remedy="start again when ready")

    def _receive(self, timeout_s: float) -> Sequence[Message]:
        if not self._open:
            raise LinkDown(f"{self.name}: the link is closed", remedy="connect again")
        return self._feed(self._transport.receive(timeout_s))

    def _queue_events(self) -> None:
        self._sort(self._receive(0.0), _accept_no_answer)

    def _sort(
        self, messages: Sequence[Message], answers: Callable[[Message], bool]
    ) -> Message | None:
        """Return the answer if the messages hold it, queue events, and raise for anything else."""
        answer = None
        for message in messages:
            # A second answer to the question belongs to no question: it falls through to the error.
            if answer is None and answers(message):
                answer = message
            elif self._is_event(message):
                self._queue(message)
            else:
                raise WireError(f"{self.name}: an unexpected message: {message!r:.120}")
        return answer

    def _queue(self, event: Message) -> None:
        if self._keeps is None or self._keeps(event):
            # A full queue drops its oldest event, which may have been the one that matters.
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
        """Close the wire without a last message; a second call does nothing."""
        self._link.close()


def _accept_no_answer(_message: object) -> bool:
    """Accept no message as an answer."""
    return False
