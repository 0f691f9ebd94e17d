"""A relay between a client and a device: notes when which bytes came, and holds them back."""

import contextlib
import queue
import socket
import threading
import time
from typing import NamedTuple, Self
from urllib.parse import urlsplit

LOOK_S = 0.005


class Piece(NamedTuple):
    """Bytes from the client, when they came by the monotonic clock."""

    at_s: float
    data: bytes


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
        self._ends = [self._listener]
        self._threads: list[threading.Thread] = []
        self.forget()

    def __enter__(self) -> Self:
        self._in_background(self._admit)
        return self

    def __exit__(self, *_: object) -> None:
        self.frozen = False
        for end in self._ends:
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()
        for thread in self._threads:
            thread.join()

    def forget(self) -> None:
        """Begin anew: nothing was heard, everything passes at once."""
        self.pieces: list[Piece] = []
        self.frozen, self.delay_s = False, 0.0

    def await_heard_s(self, word: bytes = b"", *, since_s: float = 0.0, within_s: float) -> float:
        """Wait until the client says something with this word, and return when it was said."""
        give_up_s = time.monotonic() + within_s
        while time.monotonic() < give_up_s:
            for piece in [*self.pieces]:
                if word in piece.data and piece.at_s >= since_s:
                    return piece.at_s
            time.sleep(LOOK_S)
        raise TimeoutError(f"{word!r} was not heard within {within_s:g} s")

    def _in_background(self, act, *arguments) -> None:
        thread = threading.Thread(target=act, args=arguments, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _admit(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:  # the listener is closed
                return
            device = socket.create_connection(self._device)
            for end in (client, device):
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._ends += [client, device]
            for source, target in ((client, device), (device, client)):
                waiting = queue.Queue()
                self._in_background(self._read, source, waiting, source is client)
                self._in_background(self._write, target, waiting)

    def _read(self, source: socket.socket, waiting: queue.Queue, is_from_client: bool) -> None:
        """Note what comes, also while nothing is passed on; no bytes are the end."""
        data = b"-"
        while data:
            try:
                data = source.recv(65536)
            except OSError:
                data = b""
            now_s = time.monotonic()
            if data and is_from_client:
                self.pieces.append(Piece(now_s, data))
            waiting.put((now_s + (0.0 if is_from_client else self.delay_s), data))

    def _write(self, target: socket.socket, waiting: queue.Queue) -> None:
        """Pass on what is due, and then the end."""
        data = b"-"
        while data:
            due_s, data = waiting.get()
            while self.frozen or time.monotonic() < due_s:
                time.sleep(LOOK_S)
            with contextlib.suppress(OSError):  # whoever it was for may have gone
                target.sendall(data) if data else target.shutdown(socket.SHUT_WR)
