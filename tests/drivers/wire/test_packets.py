"""Packets: cutting a byte stream, and refusing sizes that cannot be."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import WireError
from drivers.wire.framing import LARGEST_PACKET_BYTES, Packet, PacketFramer, encode_packet

INT32 = st.integers(-(2**31), 2**31 - 1)
PACKETS = st.lists(st.builds(Packet, INT32, st.binary(max_size=50)), max_size=5)


def test_packet_is_size_type_and_body_little_endian_up_to_the_largest():
    assert encode_packet(Packet(8, b"\x1b\0\0\0")).hex() == "0c000000080000001b000000"
    packet = Packet(3, bytes(LARGEST_PACKET_BYTES - 8))
    assert PacketFramer().feed(encode_packet(packet)) == [packet]


@given(packets=PACKETS, trailing=st.binary(max_size=7))
def test_stream_is_cut_into_the_packets_that_made_it(packets, trailing):
    stream = b"".join(map(encode_packet, packets))
    assert PacketFramer().feed(stream + trailing) == packets


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
