"""Conversation of one client with a simulated device, without any I/O; faults hit its messages.

A `ServedSession` is the device in the words of a protocol: it is given bytes and the time, and says
whole messages. A `Conversation` puts these messages into a queue with the time before which each
must not go out. A message waits for the one before it, as bytes on a wire do: one late answer
delays all that follow. A scripted fault changes the message at which it is due, nothing else:

- late: it goes out later;           - garbage: all but its last byte are replaced;
- torn: its second half goes out later, or never;
- silent: it never goes out;         - close: the connection ends in its place.

The carrier (`InProcessCell`, `CellServer`) moves the bytes: it asks `going`, sends, and reports the
number of sent bytes to `gone`.
"""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from functools import partial

from drivers.errors import WireError
from sim.faults import Fault

LATE_S = 600.0
"""Lateness of a message for which the script states no seconds."""
GARBLED = bytes(code ^ 0xA5 for code in range(256))
"""Each byte's replacement: a fixed one, so that a fault repeats itself."""


class ServedSession(ABC):
    """A simulated device's side of one connection."""

    @abstractmethod
    def received(self, data: bytes, now_s: float) -> None:
        """Receive bytes from the client; raises `WireError` to hang up."""

    def advance(self, now_s: float) -> None:  # noqa: B027 - not every protocol says things unasked
        """Send what is due by now."""

    def next_due_s(self) -> float | None:
        """Return the time of the next call of `advance`; None when nothing is pending."""
        return None

    @abstractmethod
    def closed(self, now_s: float) -> None:
        """End what the client had begun, after it has left."""


SessionFactory = Callable[[Callable[[bytes], None], int], ServedSession]
"""Factory of a session by its `send` and how many connections its device already has."""

_Item = tuple[float, bytes | None]
"""Time before which bytes do not go out, and the bytes; None: the connection ends."""


class Conversation:
    """A session and its messages, in order, each of which may be hit by one fault.

    `is_over` is set when either side has hung up.
    """

    def __init__(
        self,
        factory: SessionFactory,
        already_open: int,
        next_fault: Callable[[], Fault | None],
        now_s: Callable[[], float],
    ) -> None:
        self.is_over = False
        self._next_fault = next_fault
        self._now_s = now_s
        self._items: deque[_Item] = deque()
        self._going = bytearray()
        self._session = factory(self._send, already_open)

    def hear(self, data: bytes) -> None:
        """Receive bytes of the client."""
        self._run(partial(self._session.received, data))

    def turn(self) -> None:
        """Let the session send what is due."""
        if not self.is_over:
            self._run(self._session.advance)

    def going(self) -> bytes:
        """Return the bytes to send now."""
        # up to the first message that is not due, or to the end of the connection
        while self._items and self._items[0][0] <= self._now_s() and not self.wants_close:
            self._going += self._items.popleft()[1] or b""
        return bytes(self._going)

    def gone(self, count: int) -> None:
        """Drop a number of bytes that have been sent."""
        del self._going[:count]

    @property
    def wants_close(self) -> bool:
        """Whether the device ends the connection next, once the bytes before have gone out."""
        return bool(self._items) and self._items[0][1] is None

    def end_as_scripted(self, *, stays: bool) -> None:
        """Hang up at a scripted end, unless the line outlives its client."""
        self._items.popleft()
        if not stays:
            self.hang_up()

    @property
    def size_bytes(self) -> int:
        """Number of bytes that have not gone out yet."""
        return len(self._going) + sum(len(data or b"") for _, data in self._items)

    def discard(self) -> None:
        """Drop everything that has not gone out."""
        self._items.clear()
        self._going.clear()

    def next_due_s(self) -> float | None:
        """Return the time of the next call of `turn`; None if all depends on the client."""
        session_s = self._session.next_due_s()
        if not self._items:
            return session_s
        item_s = self._items[0][0]
        return item_s if session_s is None else min(item_s, session_s)

    def hang_up(self) -> None:
        """End the conversation; a second time does nothing."""
        if not self.is_over:
            self.is_over = True
            self._session.closed(self._now_s())

    def _run(self, step: Callable[[float], None]) -> None:
        try:
            step(self._now_s())
        except WireError:
            # bytes out of the protocol: a real device, too, can only end such a connection
            self.hang_up()

    def _send(self, message: bytes) -> None:
        # every message counts as an answer for the fault script, also one that was not asked for
        fault, now_s = self._next_fault(), self._now_s()
        items = [(now_s, message)] if fault is None else _apply_fault(message, fault, now_s)
        self._items.extend(items)


def _apply_fault(message: bytes, fault: Fault, now_s: float) -> list[_Item]:
    """Return what goes out of a message that a fault has hit, and when."""
    if fault.kind == "late":
        return [(now_s + (LATE_S if fault.seconds is None else fault.seconds), message)]
    if fault.kind == "garbage":  # its last byte stays, so that a line still ends
        return [(now_s, message[:-1].translate(GARBLED) + message[-1:])]
    if fault.kind == "torn":
        half = len(message) // 2
        second = [] if fault.seconds is None else [(now_s + fault.seconds, message[half:])]
        return [(now_s, message[:half]), *second]
    if fault.kind == "close":
        return [(now_s, None)]
    return []  # silent
