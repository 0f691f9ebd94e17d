"""One client of one simulated device: its pipe, its session, what is still to be said to it."""

import selectors
from collections.abc import Callable
from functools import partial
from typing import Protocol

from drivers.errors import WireError
from sim.servers.channels import Channel
from sim.servers.outbox import Outbox

PAUSE_ABOVE_BYTES = 256 * 1024
"""A client that asks without reading is not listened to until it has read."""
READS_A_TURN = 4
GIVE_UP_ABOVE_BYTES = 1024 * 1024


class Session(Protocol):
    """A simulated device's side of one connection, without any I/O."""

    def received(self, data: bytes, now_s: float) -> None:
        """Bytes from the client; may raise `WireError` to hang up."""
        ...

    def advance(self, now_s: float) -> None:
        """Say what is due by now."""
        ...

    def next_due_s(self) -> float | None:
        """When `advance` should be called next; None when nothing is pending."""
        ...

    def closed(self, now_s: float) -> None:
        """The client has gone."""
        ...


SessionFactory = Callable[[Callable[[bytes], None], int], Session]
"""Makes a session from its `send` and the number of this device's connections already open."""


class Peer:
    """Moves bytes between a pipe and a session; over when `is_over`."""

    def __init__(
        self,
        channel: Channel,
        outbox: Outbox,
        factory: SessionFactory,
        already_open: int,
        now_s: Callable[[], float],
    ) -> None:
        self.channel = channel
        self.is_over = False
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
        """What the selector should watch for."""
        if self._is_paused():
            return selectors.EVENT_WRITE
        waits = bool(self._outbox.due(self._now_s()))
        return selectors.EVENT_READ | (selectors.EVENT_WRITE if waits else 0)

    def next_due_s(self) -> float | None:
        """When `turn` should be called next."""
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
        data = self.channel.read()
        if data is None:
            self.hang_up()
        elif data:
            self._let(partial(self._session.received, data))
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
            count = self.channel.write(data)
            self._outbox.written(count or 0)
            if count is None:
                self.hang_up()
        if self._outbox.size_bytes > GIVE_UP_ABOVE_BYTES:
            self._give_up()
        elif self._outbox.wants_close:
            self._close_as_scripted()

    def _give_up(self) -> None:
        """Nobody reads: a socket is closed, a serial line loses what was said."""
        self._outbox.discard()
        if not self.channel.keeps_open:
            self.hang_up()

    def _close_as_scripted(self) -> None:
        self._outbox.wants_close = False
        if not self.channel.keeps_open:
            self.hang_up()
