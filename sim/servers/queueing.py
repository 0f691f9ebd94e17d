"""Session of a device that works on one request at a time, and keeps the next ones meanwhile."""

from abc import abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from typing_extensions import override

from drivers.wire.framing import LineFramer
from sim.servers.peers import ServedSession

MOST_WAITING = 100
"""Requests that are kept while one is worked on; what comes above is lost, as in a full buffer."""

Request = TypeVar("Request")
Outcome = TypeVar("Outcome")


@dataclass(frozen=True)  # slots and a generic of given types do not go together
class Later(Generic[Outcome]):
    """Work that takes time: when it ends, and what then comes of it."""

    due_s: float
    finish: Callable[[float], Outcome]


class QueueingSession(ServedSession, Generic[Request, Outcome]):
    """Answers one client by lines, one request after another.

    `live` lets happen what is due with the device, whose next event is at `next_event_s`.
    """

    def __init__(
        self,
        lines: LineFramer,
        live: Callable[[float], None],
        next_event_s: Callable[[], float | None],
    ) -> None:
        self._lines = lines
        self._live, self._next_event_s = live, next_event_s
        self._waiting: deque[Request] = deque()
        self._pending: tuple[Request, Later[Outcome]] | None = None
        """The one request that is worked on."""

    @override
    def received(self, data: bytes, now_s: float) -> None:
        """Obey every line that these bytes complete; what takes time is answered by `advance`."""
        for line in self._lines.feed(data):
            if line:
                request = self._read(line)
                if request is not None and len(self._waiting) < MOST_WAITING:
                    self._waiting.append(request)
                self.advance(now_s)

    @override
    def advance(self, now_s: float) -> None:
        """Answer what is due, and go on with what waits behind it."""
        self._live(now_s)
        while self._pending is not None or self._waiting:
            if self._pending is None:
                request = self._waiting.popleft()
                outcome = self._obey(request, now_s)
            else:
                request, later = self._pending
                if now_s < later.due_s:
                    return
                outcome, self._pending = later.finish(now_s), None
            if isinstance(outcome, Later):
                self._pending = request, outcome
            else:
                self._answer(request, outcome)

    @override
    def next_due_s(self) -> float | None:
        """Time of the next thing that happens by itself."""
        times = [self._next_event_s(), self._pending[1].due_s if self._pending else None]
        return min((time_s for time_s in times if time_s is not None), default=None)

    @override
    def closed(self, now_s: float) -> None:
        """Forget what was worked on; the beam stays where it is."""
        self._pending = None
        self._waiting.clear()

    @abstractmethod
    def _read(self, line: bytes) -> Request | None:
        """Request of a line; None for one that is answered already, or to which nothing is said."""

    @abstractmethod
    def _obey(self, request: Request, now_s: float) -> Outcome | Later[Outcome]:
        """Do what a request wants, or begin to."""

    @abstractmethod
    def _answer(self, request: Request, outcome: Outcome) -> None:
        """Say what came of a request."""
