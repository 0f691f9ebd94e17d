"""Transports: a device's place as a URL, a socket or a serial line.

A transport is a pipe of bytes, and a socket and a serial line make no difference to its user:
`send` all of it, `receive` what has arrived, both within a time limit, and `close`. A broken or
closed pipe raises `LinkDown` on every call; silence is no error, but no bytes. Messages are cut out
of the bytes elsewhere (`drivers/wire/framing.py`), and deadlines of questions are kept by the link.

1. `parse_address` checks a URL when a campaign is read, long before anything is connected.
2. `opener_of` makes an opener, which a session calls for each connection. It keeps the address of
   the socket that answered first, so that a later connection asks no resolver of names.
"""

import re
import socket
from typing import Any, Literal, Protocol
from urllib.parse import SplitResult, parse_qs, urlsplit

import serial

from drivers.errors import AddressInvalid, LinkDown

DEFAULT_BAUD = 115200
CHUNK_BYTES, SERIAL_CHUNK_BYTES = 65536, 4096
CONNECT_S = 5.0
"""Time in which a device must accept a connection, s."""
# A time limit of zero would make a socket non-blocking: it would send a part, and raise.
SHORTEST_SEND_S = 1e-3
"""Least time limit of a sending, s."""
URL_FORMS = "use tcp://HOST:PORT or serial:///dev/ttyUSB0?baud=115200"

_BAUD = re.compile(r"[1-9][0-9]{0,7}")

Address = tuple[Literal["tcp", "serial"], str, int]
"""Kind of the place; host and port of a socket, device and baud rate of a serial line."""
Peer = tuple[int, Any]
"""Family of a socket, and the address of that family that has answered."""


def parse_address(url: str) -> Address:
    """Read a device's URL; raises `AddressInvalid`."""
    try:
        parts = urlsplit(url)
        if parts.scheme == "tcp":
            return _tcp_address(parts)
        if parts.scheme == "serial":
            return _serial_address(parts)
    except ValueError as error:
        raise AddressInvalid(f"device URL '{url}': {error}", remedy=URL_FORMS) from error
    raise AddressInvalid(f"device URL '{url}' is neither TCP nor serial", remedy=URL_FORMS)


def _tcp_address(parts: SplitResult) -> Address:
    if not parts.hostname or not parts.port:
        raise ValueError("host or port is missing")
    if parts.path not in {"", "/"} or parts.query or parts.fragment or "@" in parts.netloc:
        raise ValueError("there is more than a host and a port")
    # An empty label (`robot..local`) or a long one would raise UnicodeError from inside `connect`.
    try:
        parts.hostname.encode("idna")
    except UnicodeError as error:
        raise ValueError(f"'{parts.hostname}' cannot be a host's name") from error
    return "tcp", parts.hostname, parts.port


def _serial_address(parts: SplitResult) -> Address:
    # With two slashes a URL's first word is a host: `serial://ttyUSB0` has no path.
    if parts.netloc or parts.path in {"", "/"}:
        raise ValueError("the device's path needs three slashes before it")
    options = parse_qs(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query))
    if unknown := options.keys() - {"baud"}:
        raise ValueError(f"option '{min(unknown)}' is not known")
    baud = options.get("baud", [str(DEFAULT_BAUD)])[-1]
    if not _BAUD.fullmatch(baud):
        raise ValueError(f"baud is '{baud}', not a number like 115200")
    return "serial", parts.path, int(baud)


class Transport(Protocol):
    """A pipe of bytes. A closed or broken pipe raises `LinkDown`, on every call."""

    @property
    def name(self) -> str:
        """Name of the device's place, for messages."""

    def send(self, data: bytes, timeout_s: float) -> None:
        """Send all of it."""

    def receive(self, timeout_s: float) -> bytes:
        """Return what has arrived, a bounded piece of it; empty when nothing came in time."""

    def close(self) -> None:
        """Close; a second time does nothing."""


class Opener(Protocol):
    """Opening of one device's transport; raises `LinkDown` within the time limit."""

    def __call__(self, *, timeout_s: float = CONNECT_S) -> Transport:
        """Connect."""


def opener_of(url: str) -> Opener:
    """Return an opener of connections to a device, which raises `AddressInvalid` or `LinkDown`.

    It resolves a host's name for its first connection only: no deadline bounds a resolver, and a
    stop of the robot may need a new connection.
    """
    peer: Peer | None = None

    def open_transport(*, timeout_s: float = CONNECT_S) -> Transport:
        nonlocal peer
        kind, place, number = parse_address(url)
        if kind == "serial":
            return SerialTransport.open(place, number)
        transport = TcpTransport.connect(place, number, timeout_s=timeout_s, peer=peer)
        peer = transport.peer
        return transport

    return open_transport


class TcpTransport:
    """A TCP connection."""

    def __init__(self, connected: socket.socket, name: str, peer: Peer | None = None) -> None:
        self._socket = connected
        self.name = name
        self.peer = peer

    @classmethod
    def connect(
        cls, host: str, port: int, *, timeout_s: float, peer: Peer | None = None
    ) -> "TcpTransport":
        """Connect to the peer, without one to the host; raises `LinkDown`.

        The time limit bounds a connection to a peer. No limit bounds the resolver of a host's name.
        """
        name = f"tcp://{host}:{port}"
        try:
            if peer is None:
                connected = socket.create_connection((host, port), timeout=timeout_s)
            else:
                connected = _connect_to(peer, timeout_s)
            peer = connected.family, connected.getpeername()
        except OSError as error:
            raise LinkDown(
                f"{name}: nobody answers ({_reason(error)})",
                remedy="check that the device is on, its cable, its address and port",
            ) from error
        # A question is one small packet: it must not wait for a second one to fill it up.
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return cls(connected, name, peer)

    def send(self, data: bytes, timeout_s: float) -> None:
        """Send all of it."""
        try:
            self._socket.settimeout(max(timeout_s, SHORTEST_SEND_S))
            self._socket.sendall(data)
        except OSError as error:
            raise self._down(error) from error

    def receive(self, timeout_s: float) -> bytes:
        """Return what has arrived; empty when nothing came in time."""
        try:
            # Zero makes the socket non-blocking: with nothing there, `recv` raises at once.
            self._socket.settimeout(max(timeout_s, 0.0))
            data = self._socket.recv(CHUNK_BYTES)
        except (BlockingIOError, TimeoutError):
            return b""
        except OSError as error:
            raise self._down(error) from error
        # A socket that is readable without bytes has been closed by its far end.
        if not data:
            raise LinkDown(
                f"{self.name}: the device closed the connection",
                remedy="check the device, then try again",
            )
        return data

    def close(self) -> None:
        """Close; a second time does nothing."""
        self._socket.close()

    def _down(self, error: OSError) -> LinkDown:
        return LinkDown(
            f"{self.name}: the connection broke ({_reason(error)})",
            remedy="check the cable and the device, then try again",
        )


def _connect_to(peer: Peer, timeout_s: float) -> socket.socket:
    family, address = peer
    connected = socket.socket(family, socket.SOCK_STREAM)
    try:
        connected.settimeout(timeout_s)
        connected.connect(address)
    except BaseException:
        connected.close()
        raise
    return connected


class SerialTransport:
    """A serial line, 8N1, held by this process alone."""

    def __init__(self, port: serial.Serial, name: str) -> None:
        self._port = port
        self.name = name

    @classmethod
    def open(cls, device: str, baud: int) -> "SerialTransport":
        """Open the line without the bytes that waited in it; raises `LinkDown`."""
        name = f"serial://{device}"
        try:
            # pyserial empties the input buffer as it opens a port. `exclusive` locks the device
            # against a second program, whose answers would be mixed with ours.
            port = serial.Serial(device, baud, exclusive=True)
        except (OSError, ValueError) as error:  # pyserial's own error is an OSError
            raise LinkDown(
                f"{name}: cannot be opened ({error})",
                remedy="check the cable, the port's name, your rights to it, "
                "and that nobody else holds it",
            ) from error
        return cls(port, name)

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
            # `read` waits until it has all bytes that it is asked for. So one is waited for, and
            # what has come with it is taken without waiting.
            first = self._port.read(1)
            waiting = min(self._port.in_waiting, SERIAL_CHUNK_BYTES - 1) if first else 0
            return first + self._port.read(waiting)
        except OSError as error:
            raise self._down(error) from error

    def close(self) -> None:
        """Close; a second time does nothing."""
        self._port.close()

    def _down(self, error: OSError) -> LinkDown:
        return LinkDown(
            f"{self.name}: the line broke ({error})",
            remedy="check the cable and the device, then try again",
        )


def _reason(error: OSError) -> str:
    return (error.strerror or str(error) or type(error).__name__).lower()
