"""A relay between a client and a device: notes when which bytes came, and holds them back."""

import select
import socket
import threading
import time
from collections import deque
from dataclasses import dataclass, field
from typing import Self
from urllib.parse import urlsplit

LOOK_S = 0.005
CHUNK_BYTES = 65536


@dataclass(frozen=True, slots=True)
class Piece:
    """Bytes from the client, when they came by the monotonic clock."""

    at_s: float
    data: bytes


@dataclass(eq=False)
class _Way:
    """One direction of a connection, and what is still on its way; None is the end."""

    source: socket.socket
    target: socket.socket
    is_from_client: bool
    waiting: deque[tuple[float, bytes | None]] = field(default_factory=deque)
    is_over: bool = False

    @property
    def is_done(self) -> bool:
        """Whether nothing comes any more, and nothing is on its way."""
        return self.is_over and not self.waiting


class Relay:
    """A context manager: clients connect to `url`, and what they say reaches the device.

    While `frozen`, nothing is passed on, as if the device did not look at its wire. Its answers are
    late by `delay_s`.
    """

    def __init__(self, device_url: str) -> None:
        place = urlsplit(device_url)
        self._device = (place.hostname, place.port)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"tcp://127.0.0.1:{self._listener.getsockname()[1]}"
        self.frozen = False
        self.delay_s = 0.0
        self.pieces: list[Piece] = []
        self._ways: list[_Way] = []
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="relay", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        for way in self._ways:
            way.source.close()
        self._listener.close()

    def forget(self) -> None:
        """Begin anew: nothing was heard, everything passes at once."""
        self.pieces.clear()
        self.frozen, self.delay_s = False, 0.0

    def heard_s(self, word: bytes = b"", since_s: float = 0.0) -> float | None:
        """When the client first said something with this word, since then."""
        said = (piece.at_s for piece in list(self.pieces) if word in piece.data)
        return next((at_s for at_s in said if at_s >= since_s), None)

    def await_heard_s(self, word: bytes = b"", *, since_s: float = 0.0, within_s: float) -> float:
        """The same, waited for; raises `TimeoutError`."""
        give_up_s = time.monotonic() + within_s
        while (at_s := self.heard_s(word, since_s)) is None:
            if time.monotonic() > give_up_s:
                raise TimeoutError(f"{word!r} was not heard within {within_s:g} s")
            time.sleep(LOOK_S)
        return at_s

    def _run(self) -> None:
        while not self._over.is_set():
            sources = [way.source for way in self._ways if not way.is_over]
            ready, _, _ = select.select([self._listener, *sources], [], [], LOOK_S)
            now_s = time.monotonic()
            if self._listener in ready:
                self._admit()
            for way in self._ways:
                if way.source in ready:
                    self._read(way, now_s)
            for way in self._ways:
                self._pass_on(way, now_s)
            self._hang_up()

    def _admit(self) -> None:
        client, _ = self._listener.accept()
        device = socket.create_connection(self._device)
        for end in (client, device):
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._ways += [
            _Way(client, device, is_from_client=True),
            _Way(device, client, is_from_client=False),
        ]

    def _hang_up(self) -> None:
        """Close the connections that are over in both directions."""
        both = list(zip(self._ways[::2], self._ways[1::2], strict=True))
        for one, other in both:
            if one.is_done and other.is_done:
                one.source.close()
                other.source.close()
        going_on = [pair for pair in both if not (pair[0].is_done and pair[1].is_done)]
        self._ways = [way for pair in going_on for way in pair]

    def _read(self, way: _Way, now_s: float) -> None:
        try:
            data = way.source.recv(CHUNK_BYTES)
        except OSError:
            data = b""
        if data and way.is_from_client:
            self.pieces.append(Piece(now_s, data))
        way.is_over = not data
        way.waiting.append((now_s + (0.0 if way.is_from_client else self.delay_s), data or None))

    def _pass_on(self, way: _Way, now_s: float) -> None:
        while way.waiting and way.waiting[0][0] <= now_s and not self.frozen:
            _, data = way.waiting.popleft()
            try:
                if data is None:
                    way.target.shutdown(socket.SHUT_WR)
                else:
                    way.target.sendall(data)
            except OSError:  # whoever it was for has gone
                return
