"""Framing: bytes to lines and to packets of bounded length, and back.

A socket or serial line brings bytes in pieces of any length: half a message, or three at once. A
framer keeps what is incomplete and returns the messages that a piece completes. It holds at most
one message, whatever a peer sends: a length that is claimed is checked before anything is kept for
it.
"""

import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeVar

from drivers.errors import WireError

# emScon: every packet begins with two 32-bit integers, little endian, its size (these eight bytes
# included) and its type. Other clients refuse packets above 64 KiB as well.
HEADER = struct.Struct("<ii")
LARGEST_PACKET_BYTES = 65536

Unit = TypeVar("Unit")
Message = TypeVar("Message")


def messages(
    cut: Callable[[bytes], Iterable[Unit]], read: Callable[[Unit], Message]
) -> Callable[[bytes], list[Message]]:
    """Return a reader of a stream's bytes: its framer's packets or lines, each read.

    Empty lines are passed over.
    """
    return lambda data: [read(unit) for unit in cut(data) if unit]


class LineFramer:
    """Lines of a stream cut at line feeds, the incomplete one kept; never raises.

    A line comes without its line feed and without a carriage return before it. One that is longer
    than `limit_bytes` (carriage return counted) comes cut to `limit_bytes + 1`, as soon as that is
    known, so that its reader sees that it is too long; its remainder is thrown away. Nothing
    that a peer sends makes this hold more than that.
    """

    def __init__(self, limit_bytes: int) -> None:
        self._kept_bytes = limit_bytes + 1
        self._partial = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """Return the lines completed by these bytes."""
        lines: list[bytes] = []
        # All pieces but the last end with a line feed; the last one begins a line.
        *line_ends, beginning = data.split(b"\n")
        for line_end in line_ends:
            self._extend(line_end, lines)
            if not self._is_cut():
                lines.append(bytes(self._partial).removesuffix(b"\r"))
            self._partial.clear()
        self._extend(beginning, lines)
        return lines

    def _is_cut(self) -> bool:
        """Return whether the present line was already handed out as too long."""
        return len(self._partial) == self._kept_bytes

    def _extend(self, piece: bytes, lines: list[bytes]) -> None:
        # The bytes of a line that is too long are thrown away up to its line feed.
        if self._is_cut():
            return
        self._partial += piece[: self._kept_bytes - len(self._partial)]
        if self._is_cut():
            lines.append(bytes(self._partial))


def ascii_bytes(text: str) -> bytes:
    """Encode a line as records keep it; raises `WireError`."""
    try:
        return text.encode("ascii")
    except UnicodeEncodeError as error:
        raise WireError(f"not a word of a device's: {text!r:.80}") from error


@dataclass(frozen=True, slots=True)
class Packet:
    """Packet, whole, without its header; `kind` is the type field."""

    kind: int
    body: bytes


def encode_packet(packet: Packet) -> bytes:
    """Write a packet; its size field counts the header too."""
    return HEADER.pack(HEADER.size + len(packet.body), packet.kind) + packet.body


class PacketFramer:
    """Packets of a byte stream.

    A size outside 8…65536 bytes raises `WireError`: the stream has lost its step for good, so every
    later call raises it too. At most one packet's bytes are kept beside what was just fed.
    """

    def __init__(self) -> None:
        self._waiting = bytearray()

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets completed by these bytes."""
        self._waiting += data
        packets: list[Packet] = []
        while (packet := self._take_packet()) is not None:
            packets.append(packet)
        return packets

    def _take_packet(self) -> Packet | None:
        """Take the first whole packet off the bytes that wait; None while it is incomplete."""
        # Even the header may come in two pieces.
        if len(self._waiting) < HEADER.size:
            return None
        size, kind = HEADER.unpack_from(self._waiting)
        # The bytes stay where they are: nothing behind a wrong size can be found again.
        if not HEADER.size <= size <= LARGEST_PACKET_BYTES:
            raise WireError(
                f"a packet claims {size} bytes, allowed are {HEADER.size} to {LARGEST_PACKET_BYTES}"
            )
        if len(self._waiting) < size:
            return None
        body = bytes(self._waiting[HEADER.size : size])
        del self._waiting[:size]
        return Packet(kind, body)
