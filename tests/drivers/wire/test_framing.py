"""Lines and packets of bounded length, however their bytes are cut."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import WireError
from drivers.wire.framing import (
    LARGEST_PACKET_BYTES,
    LineFramer,
    Packet,
    PacketFramer,
    encode_packet,
)

LIMIT = 8
streams = st.lists(st.sampled_from([b"\n", b"\r", b"\r\n", b"a", b"bcd", b"e" * 20])).map(b"".join)


def lines_of(pieces):
    framer = LineFramer(LIMIT)
    return [line for piece in pieces for line in framer.feed(piece)]


@pytest.mark.parametrize(
    ("stream", "lines"),
    [
        (b"", []),
        (b"begun", []),
        (b"whole\r\n", [b"whole"]),
        (b"a\rb\r\r\n", [b"a\rb\r"]),
        (b"one\ntwo\nthr", [b"one", b"two"]),
        (b"\n\n", [b"", b""]),
        (b"12345678\n", [b"12345678"]),
        (b"1234567\r\n", [b"1234567"]),
        (b"1234567890 and more\nnext\n", [b"123456789", b"next"]),
        (b"12345678\r\nnext\n", [b"12345678\r", b"next"]),
    ],
)
def test_stream_is_cut_into_lines(stream, lines):
    assert lines_of([stream]) == lines
    assert lines_of([bytes([byte]) for byte in stream]) == lines


def test_line_that_is_too_long_is_returned_cut_before_it_ends_and_its_remainder_dropped():
    framer = LineFramer(LIMIT)
    assert framer.feed(b"1234567") == []
    assert framer.feed(b"89") == [b"123456789"]
    assert framer.feed(b"still the same line") == []
    assert framer.feed(b"\nnext\n") == [b"next"]


@given(streams | st.binary(), st.data())
def test_lines_are_the_same_however_the_stream_is_cut(stream, data):
    cuts = sorted(data.draw(st.sets(st.integers(0, len(stream)))))
    pieces = [stream[a:b] for a, b in zip([0, *cuts], [*cuts, len(stream)], strict=True)]
    assert lines_of(pieces) == lines_of([stream])


def test_packet_is_size_type_and_body_little_endian_up_to_the_largest():
    assert encode_packet(Packet(8, b"\x1b\0\0\0")).hex() == "0c000000080000001b000000"
    packet = Packet(3, bytes(LARGEST_PACKET_BYTES - 8))
    assert PacketFramer().feed(encode_packet(packet)) == [packet]


@pytest.mark.parametrize("size", [-1, 0, 7, LARGEST_PACKET_BYTES + 1, 2**31 - 1])
def test_impossible_size_is_refused_before_its_body_comes(size):
    header = size.to_bytes(4, "little", signed=True) + bytes(4)
    with pytest.raises(WireError, match=rf"claims {size} bytes, allowed are 8 to 65536"):
        PacketFramer().feed(header)


def test_stream_that_lost_its_step_stays_refused():
    framer = PacketFramer()
    with pytest.raises(WireError):
        framer.feed(bytes(8))
    with pytest.raises(WireError):
        framer.feed(encode_packet(Packet(8, bytes(4))))
