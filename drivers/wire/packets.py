"""Packets of a size, a type (two little-endian 32-bit integers) and a body; no I/O."""

import struct
from dataclasses import dataclass

from drivers.errors import WireError

HEADER = struct.Struct("<ii")
LARGEST_PACKET_BYTES = 65536


@dataclass(frozen=True, slots=True)
class Packet:
    """One whole packet without its header; `kind` is the type field."""

    kind: int
    body: bytes


def encode_packet(packet: Packet) -> bytes:
    """Write a packet; its size field counts the header too."""
    return HEADER.pack(HEADER.size + len(packet.body), packet.kind) + packet.body


class PacketFramer:
    """Cuts a byte stream into packets.

    A size outside 8…65536 bytes raises `WireError`: the stream has lost its step for good, so every
    later call raises it too. At most one packet's bytes are kept beside what was just fed.
    """

    def __init__(self) -> None:
        self._waiting = bytearray()

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets completed by these bytes."""
        self._waiting += data
        packets: list[Packet] = []
        while (packet := self._next()) is not None:
            packets.append(packet)
        return packets

    def _next(self) -> Packet | None:
        if len(self._waiting) < HEADER.size:
            return None
        size, kind = HEADER.unpack_from(self._waiting)
        if not HEADER.size <= size <= LARGEST_PACKET_BYTES:
            raise WireError(
                f"a packet claims {size} bytes, allowed are {HEADER.size} to {LARGEST_PACKET_BYTES}"
            )
        if len(self._waiting) < size:
            return None
        body = bytes(self._waiting[HEADER.size : size])
        del self._waiting[:size]
        return Packet(kind, body)
