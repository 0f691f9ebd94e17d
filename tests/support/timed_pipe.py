"""A byte pipe on a hand-moved clock: a test writes down what the other end says, and when."""

from collections.abc import Callable, Iterable

from drivers.errors import LinkDown
from drivers.transport import CONNECT_S

Timed = tuple[float, bytes]


class HandClock:
    """Time that passes only when somebody waits."""

    def __init__(self):
        self.time_s = 0.0

    def now_s(self):
        return self.time_s

    def sleep_s(self, seconds):
        self.time_s += seconds

    def real_s(self, virtual_s):
        """Say "soon": nobody knows when this clock will be moved, so a server looks again."""
        return min(0.001, max(virtual_s, 0.0))


class TimedPipe:
    """Answers what is sent by `respond`, which says after how many seconds which bytes come."""

    name = "pipe://test"

    def __init__(
        self, clock: HandClock, respond: Callable[[bytes], Iterable[Timed]] = lambda _: ()
    ):
        self.clock = clock
        self.respond = respond
        self.sent: list[bytes] = []
        self.is_closed = False
        self._coming: list[Timed] = []

    def arrives(self, after_s: float, data: bytes):
        """Have these bytes come in; none means that the other end closes."""
        self._coming.append((self.clock.now_s() + after_s, data))
        self._coming.sort(key=lambda timed: timed[0])

    def send(self, data, timeout_s):
        self._raise_if_closed()
        self.sent.append(data)
        for after_s, answer in self.respond(data):
            self.arrives(after_s, answer)

    def receive(self, timeout_s):
        self._raise_if_closed()
        latest_s = self.clock.now_s() + timeout_s
        if not self._coming or self._coming[0][0] > latest_s:
            self.clock.time_s = latest_s
            return b""
        at_s, data = self._coming.pop(0)
        self.clock.time_s = max(self.clock.now_s(), at_s)
        if not data:
            raise LinkDown("pipe://test: the device closed the connection", remedy="-")
        return data

    def close(self):
        self.is_closed = True

    def _raise_if_closed(self):
        if self.is_closed:
            raise LinkDown("pipe://test: closed", remedy="-")


class FarEnd:
    """The other end of a driver's connections, each of which is a new pipe on one clock.

    It takes so many connections, each after so long; `waiting` bytes are in the line at the next.
    """

    def __init__(self):
        self.clock = HandClock()
        self.pipes: list[TimedPipe] = []
        self.connections = 1000
        self.accepts_after_s = 0.0
        self.waiting = b""

    @property
    def pipe(self):
        return self.pipes[-1]

    def open(self, *, timeout_s=CONNECT_S):
        self.clock.sleep_s(min(self.accepts_after_s, timeout_s))
        if self.accepts_after_s > timeout_s:
            raise LinkDown("pipe://test: nobody answers (timed out)", remedy="-")
        if len(self.pipes) >= self.connections:
            self.clock.sleep_s(0.1)
            raise LinkDown("pipe://test: nobody answers", remedy="-")
        self.pipes.append(TimedPipe(self.clock, self.respond))
        if self.waiting:
            self.pipe.arrives(0.0, self.waiting)
            self.waiting = b""
        return self.pipe

    def respond(self, data):
        """What is answered to these bytes, and after how many seconds."""
        raise NotImplementedError
