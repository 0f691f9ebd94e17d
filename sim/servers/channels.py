"""Byte pipes as the simulated cell's server holds them: never waiting, never raising."""

import contextlib
import os
import socket
from typing import Protocol

CHUNK_BYTES = 65536


class Channel(Protocol):
    """One connection's pipe."""

    keeps_open: bool
    """Whether it outlives its client, as a serial line does."""

    def fileno(self) -> int:
        """For the selector."""
        ...

    def read(self) -> bytes | None:
        """What has come, empty if nothing; None when the client has gone."""
        ...

    def write(self, data: bytes) -> int | None:
        """How many bytes went out; None when the client has gone."""
        ...

    def close(self) -> None:
        """Close."""
        ...


class TcpChannel:
    """An accepted socket."""

    keeps_open = False

    def __init__(self, accepted: socket.socket) -> None:
        self._socket = accepted
        accepted.settimeout(0.0)
        accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def fileno(self) -> int:
        """For the selector."""
        return self._socket.fileno()

    def read(self) -> bytes | None:
        """What has come, empty if nothing; None when the client has gone."""
        try:
            return self._socket.recv(CHUNK_BYTES) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def write(self, data: bytes) -> int | None:
        """How many bytes went out; None when the client has gone."""
        try:
            return self._socket.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            return None

    def close(self) -> None:
        """Close."""
        self._socket.close()


class PtyChannel:
    """The device's end of a pseudo-terminal.

    The client's end is held open too: a serial line does not notice who is there.
    """

    keeps_open = True

    def __init__(self, device_end: int, client_end: int) -> None:
        self._device_end = device_end
        self._client_end = client_end
        os.set_blocking(device_end, False)

    def fileno(self) -> int:
        """For the selector."""
        return self._device_end

    def read(self) -> bytes | None:
        """What has come, empty if nothing."""
        with contextlib.suppress(OSError):
            return os.read(self._device_end, CHUNK_BYTES)
        return b""

    def write(self, data: bytes) -> int | None:
        """How many bytes went out."""
        with contextlib.suppress(OSError):
            return os.write(self._device_end, data)
        return 0

    def close(self) -> None:
        """Close both ends."""
        os.close(self._device_end)
        os.close(self._client_end)
