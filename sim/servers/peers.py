"""Clients of the simulated cell's server: their pipes, their queues that faults hit, sessions."""

import os
import selectors
import socket
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from functools import partial

from drivers.errors import WireError
from sim.faults import Fault

CHUNK_BYTES = 65536
LATE_S = 600.0
GARBLED = bytes(code ^ 0xA5 for code in range(256))
PAUSE_ABOVE_BYTES = 256 * 1024
"""A client that asks without reading is not listened to until it has read."""
READS_A_TURN = 4
GIVE_UP_ABOVE_BYTES = 1024 * 1024


class SerialEnd:
    """Device's end of a pseudo-terminal, in the words of a socket.

    The client's end is held open too, as a serial line does not notice who is there.
    """

    def __init__(self, device_end: int, client_end: int) -> None:
        os.set_blocking(device_end, False)
        self._ends = device_end, client_end
        self.recv = partial(os.read, device_end)
        self.send = partial(os.write, device_end)

    def fileno(self) -> int:
        """File descriptor for the selector."""
        return self._ends[0]

    def close(self) -> None:
        """Close both ends."""
        for end in self._ends:
            os.close(end)


Channel = socket.socket | SerialEnd
"""Pipe of one connection, which never waits."""


_Item = tuple[float, bytes | None]
"""Bytes that go out not before a time; None is the end of the connection."""


class SendQueue:
    """Messages in order. Each may be hit by one fault, decided when it is put in."""

    def __init__(self, next_fault: Callable[[], Fault | None]) -> None:
        self._next_fault = next_fault
        self._items: deque[_Item] = deque()
        self._going = bytearray()
        self.wants_close = False

    @property
    def size_bytes(self) -> int:
        """Number of bytes that have not gone out yet."""
        return len(self._going) + sum(len(data or b"") for _, data in self._items)

    def put(self, message: bytes, now_s: float) -> None:
        """Add one whole message of the device."""
        fault = self._next_fault()
        self._items.extend([(now_s, message)] if fault is None else _hit(message, fault, now_s))

    def due(self, now_s: float) -> bytes:
        """The bytes to write now. A message waits for the one before it."""
        while self._items and self._items[0][0] <= now_s and not self.wants_close:
            _, data = self._items.popleft()
            self._going += data or b""
            self.wants_close = data is None
        return bytes(self._going)

    def written(self, count: int) -> None:
        """Drop so many bytes that have gone out."""
        del self._going[:count]

    def next_due_s(self) -> float | None:
        """Time when the next message may go out."""
        return self._items[0][0] if self._items else None

    def discard(self) -> None:
        """Forget everything that has not gone out."""
        self._items.clear()
        self._going.clear()


def _hit(message: bytes, fault: Fault, now_s: float) -> list[_Item]:
    """Rest of a message that a fault has hit."""
    if fault.kind == "late":
        return [(now_s + (LATE_S if fault.seconds is None else fault.seconds), message)]
    if fault.kind == "garbage":  # its last byte stays, so that a line still ends
        return [(now_s, message[:-1].translate(GARBLED) + message[-1:])]
    if fault.kind == "torn":
        half = len(message) // 2
        rest = [] if fault.seconds is None else [(now_s + fault.seconds, message[half:])]
        return [(now_s, message[:half]), *rest]
    if fault.kind == "close":
        return [(now_s, None)]
    return []  # silent


class ServedSession(ABC):
    """A simulated device's side of one connection, without any I/O."""

    @abstractmethod
    def received(self, data: bytes, now_s: float) -> None:
        """Bytes from the client; may raise `WireError` to hang up."""

    def advance(self, now_s: float) -> None:  # noqa: B027 - not every protocol says things unasked
        """Say what is due by now."""

    def next_due_s(self) -> float | None:
        """Time of the next call of `advance`; None when nothing is pending."""
        return None

    @abstractmethod
    def closed(self, now_s: float) -> None:
        """The client has gone."""


SessionFactory = Callable[[Callable[[bytes], None], int], ServedSession]
"""Factory of a session by its `send` and how many connections its device already has."""


class Peer:
    """Peer between a pipe and a session; over when `is_over`."""

    def __init__(
        self,
        channel: Channel,
        outbox: SendQueue,
        factory: SessionFactory,
        already_open: int,
        now_s: Callable[[], float],
    ) -> None:
        self.channel = channel
        self.is_over = False
        self._keeps_open = isinstance(channel, SerialEnd)
        """Whether the pipe outlives its client, as a serial line does."""
        self._outbox = outbox
        self._now_s = now_s
        self._session = factory(self._say, already_open)

    def ready(self) -> None:
        """Take what has come, the client's leaving too, unless there is too much to say yet."""
        for _ in range(READS_A_TURN):
            if self.is_over or self._is_paused() or not self._take():
                return

    def turn(self) -> None:
        """Let the session say what is due, and write what goes out."""
        self._let(self._session.advance)
        if not self.is_over:
            self._flush()

    def interest(self) -> int:
        """Events that the selector should watch for."""
        if self._is_paused():
            return selectors.EVENT_WRITE
        waits = bool(self._outbox.due(self._now_s()))
        return selectors.EVENT_READ | (selectors.EVENT_WRITE if waits else 0)

    def next_due_s(self) -> float | None:
        """Time of the next call of `turn`."""
        times = [
            t for t in (self._session.next_due_s(), self._outbox.next_due_s()) if t is not None
        ]
        return min(times, default=None)

    def hang_up(self) -> None:
        """Part with the client; what has been said so far still goes out if it can."""
        if self.is_over:
            return
        self.is_over = True
        self._session.closed(self._now_s())
        self._flush()

    def _take(self) -> bool:
        """Take one piece; false when there is no more."""
        try:
            data = self.channel.recv(CHUNK_BYTES)
        except BlockingIOError:
            return False
        except OSError:
            data = b""
        if data:
            self._let(partial(self._session.received, data))
        elif not self._keeps_open:
            self.hang_up()  # the client has gone
        return bool(data)

    def _is_paused(self) -> bool:
        return len(self._outbox.due(self._now_s())) > PAUSE_ABOVE_BYTES

    def _say(self, message: bytes) -> None:
        self._outbox.put(message, self._now_s())

    def _let(self, step: Callable[[float], None]) -> None:
        try:
            step(self._now_s())
        except WireError:
            self.hang_up()

    def _flush(self) -> None:
        if data := self._outbox.due(self._now_s()):
            try:
                self._outbox.written(self.channel.send(data))
            except BlockingIOError:
                pass
            except OSError:
                self._lose()
        if self._outbox.size_bytes > GIVE_UP_ABOVE_BYTES:
            self._give_up()
        elif self._outbox.wants_close:
            self._close_as_scripted()

    def _give_up(self) -> None:
        """Give up on a client that reads nothing: close a socket, empty a serial line's queue."""
        self._outbox.discard()
        self._lose()

    def _close_as_scripted(self) -> None:
        self._outbox.wants_close = False
        self._lose()

    def _lose(self) -> None:
        """Hang up, unless there is a line that stays."""
        if not self._keeps_open:
            self.hang_up()
