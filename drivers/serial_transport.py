"""A serial line as a byte pipe, by pyserial."""

import serial

from drivers.errors import LinkDown
from drivers.transport import SerialAddress

CHUNK_BYTES = 4096
SHORTEST_SEND_S = 1e-3
"""A time limit of zero would mean a port that never waits, not an impatient one."""


class SerialTransport:
    """A serial line, 8N1, held by this process alone."""

    def __init__(self, port: serial.Serial, name: str) -> None:
        self._port = port
        self._name = name

    @classmethod
    def open(cls, address: SerialAddress) -> "SerialTransport":
        """Open and empty it, or raise `LinkDown`."""
        name = f"serial://{address.device}"
        try:
            port = serial.Serial(address.device, address.baud, exclusive=True)
        except (OSError, ValueError) as error:  # pyserial's own error is an OSError
            raise LinkDown(
                f"{name}: cannot be opened ({error})",
                remedy="check the cable, the port's name, your rights to it, "
                "and that nobody else holds it",
            ) from error
        return cls(port, name)

    @property
    def name(self) -> str:
        """Name of the line."""
        return self._name

    def send(self, data: bytes, timeout_s: float) -> None:
        """Send all of it."""
        try:
            self._port.write_timeout = max(timeout_s, SHORTEST_SEND_S)
            self._port.write(data)
        except OSError as error:
            raise self._down(error) from error

    def receive(self, timeout_s: float) -> bytes:
        """Return what has arrived; empty when nothing came in time."""
        try:
            self._port.timeout = max(timeout_s, 0.0)
            first = self._port.read(1)
            waiting = min(self._port.in_waiting, CHUNK_BYTES - 1) if first else 0
            return first + self._port.read(waiting)
        except OSError as error:
            raise self._down(error) from error

    def close(self) -> None:
        """Close; a second time does nothing."""
        self._port.close()

    def _down(self, error: OSError) -> LinkDown:
        return LinkDown(
            f"{self._name}: the line broke ({error})",
            remedy="check the cable and the device, then try again",
        )
