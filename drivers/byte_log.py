"""Byte log: what each wire carried, as text or in hexadecimal digits, by `logging`."""

import logging

from drivers.errors import DriverError
from drivers.transport import CONNECT_S, Opener, Transport

LOGGER = logging.getLogger(__name__)


class LoggedTransport:
    """A byte pipe that logs what it carries."""

    def __init__(self, pipe: Transport, device: str) -> None:
        self.name = pipe.name
        self._pipe, self._device = pipe, device

    def send(self, data: bytes, timeout_s: float) -> None:
        """Log and send all of it: it may arrive even where sending fails."""
        LOGGER.debug("%s > %s", self._device, readable(data))
        self._pipe.send(data, timeout_s)

    def receive(self, timeout_s: float) -> bytes:
        """Return and log what has arrived; silence is not logged."""
        try:
            data = self._pipe.receive(timeout_s)
        except DriverError as error:
            LOGGER.debug("%s ! %s", self._device, error.problem)
            raise
        if data:
            LOGGER.debug("%s < %s", self._device, readable(data))
        return data

    def close(self) -> None:
        """Close the pipe; a second time does nothing."""
        self._pipe.close()


def logged(open_pipe: Opener, device: str) -> Opener:
    """Return an opener of pipes that log what they carry."""

    def open_logged(*, timeout_s: float = CONNECT_S) -> Transport:
        return LoggedTransport(open_pipe(timeout_s=timeout_s), device)

    return open_logged


def readable(data: bytes) -> str:
    """Return lines of ASCII as text with its line ends escaped, other bytes in hexadecimal."""
    text = data.decode("ascii", errors="replace")
    plain = text.replace("\r", "").replace("\n", "")
    return repr(text) if plain.isascii() and plain.isprintable() else data.hex(" ")
