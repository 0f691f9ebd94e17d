"""emScon messages: the example packets both ways, round trips, garbage."""

import json
import struct
from dataclasses import asdict
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import WireError
from drivers.wire import emscon
from drivers.wire import emscon_messages as said
from drivers.wire.emscon import Answer, EmsconRequest
from drivers.wire.emscon_constants import Command, ResultStatus
from drivers.wire.framing import Packet

UNITS = said.Units(1, 1, 0, 0, 0)
GOLDEN = json.loads((Path(__file__).parents[2] / "data/emscon-golden.json").read_text())["packets"]

INT32 = st.integers(-(2**31), 2**31 - 1)
DOUBLE = st.floats(allow_nan=False)
TEXT = st.text(st.characters(max_codepoint=0xFFFF, exclude_categories=["Cs"]), max_size=31).map(
    lambda text: text.replace("\0", "")
)
VALUES = {int: INT32, float: DOUBLE, said.Triple: st.tuples(DOUBLE, DOUBLE, DOUBLE), str: TEXT}


def bodies(kind):
    return st.builds(kind, *(VALUES[form] for form in said.annotations_of(kind)))


REQUESTS = st.sampled_from(Command).flatmap(
    lambda c: bodies(emscon.REQUESTS.get(c, said.Nothing)).map(lambda body: EmsconRequest(c, body))
)
ANSWERS = st.sampled_from(Command).flatmap(
    lambda c: bodies(emscon.ANSWERS.get(c, said.Nothing)).map(lambda body: Answer(c, 0, body))
)
UNASKED = st.sampled_from(get_args(emscon.Unasked)).flatmap(bodies)
OTHERS = st.builds(Packet, st.sampled_from([3, 4, 5, 6, 10, 11]).map(int), st.binary(max_size=40))
FROM_SERVER = st.one_of(ANSWERS, UNASKED, OTHERS)


@pytest.mark.parametrize("case", GOLDEN, ids=lambda case: case["name"])
def test_example_packet_means_what_its_fields_say_and_is_written_again_byte_for_byte(case):
    packet = bytes.fromhex(case["bytes"])
    read = emscon.from_client() if case["type"] == "EmsconRequest" else emscon.from_server()
    (message,) = read(packet)
    assert type(message).__name__ == case["type"]
    assert json.loads(json.dumps(asdict(message))) == case["message"]
    assert emscon.encode(message) == packet


@given(messages=st.lists(REQUESTS, max_size=3), cut=st.integers(0, 200))
def test_requests_survive_the_wire_in_two_pieces(messages, cut):
    stream, feed = b"".join(map(emscon.encode, messages)), emscon.from_client()
    assert feed(stream[:cut]) + feed(stream[cut:]) == messages


@given(messages=st.lists(FROM_SERVER, max_size=3))
def test_answers_survive_the_wire_byte_by_byte_and_whole(messages):
    stream, feed = b"".join(map(emscon.encode, messages)), emscon.from_server()
    assert [m for byte in stream for m in feed(bytes([byte]))] == messages
    assert emscon.from_server()(stream + stream[:5]) == messages


@given(data=st.binary(min_size=196, max_size=196))
def test_a_result_is_kept_to_the_last_bit(data):
    assert said.encode_body(said.decode_body(said.SingleResult2, data)) == data


def test_refusal_is_read_with_or_without_what_would_follow():
    bare = struct.pack("<iiii", 16, 0, 1, 1)
    padded = struct.pack("<iiii", 56, 0, 1, 1) + bytes(40)
    assert emscon.refusal(Command.GET_SYSTEM_STATUS, ResultStatus.SERVER_BUSY) == padded
    expected = [Answer(Command.GET_SYSTEM_STATUS, ResultStatus.SERVER_BUSY)]
    assert emscon.from_server()(bare) == expected
    assert emscon.from_server()(padded) == expected


def test_commands_without_grammar_are_named_to_the_server_and_refused_as_answers():
    assert emscon.from_client()(emscon.encode(emscon.UnknownRequest(144))) == [
        emscon.UnknownRequest(144)
    ]
    with pytest.raises(WireError, match="answer to command 144"):
        emscon.from_server()(emscon.refusal(144, 0))


def test_packet_of_an_unknown_type_is_read_as_such_if_its_size_is_sound():
    unknown, change = struct.pack("<iii", 12, 99, 1), said.StatusChange(27)
    packets = emscon.from_server()(unknown + emscon.encode(change))
    assert packets == [Packet(99, bytes((1, 0, 0, 0))), change]
    with pytest.raises(WireError, match="claims 7 bytes"):
        emscon.from_server()(struct.pack("<ii", 7, 99))


@pytest.mark.parametrize(
    "message",
    [said.StatusChange(27), said.ErrorResponse(49, 36), Answer(Command.GET_UNITS, 0, UNITS)],
)
def test_fields_that_later_firmware_appends_are_passed_over(message):
    data = emscon.encode(message)
    longer = struct.pack("<i", len(data) + 12) + data[4:] + bytes(range(12))
    assert emscon.from_server()(longer + data) == [message, message]
    shorter = struct.pack("<i", len(data) - 1) + data[4:-1]
    with pytest.raises(WireError):
        emscon.from_server()(shorter)


def test_a_client_is_held_to_commands_of_their_size():
    data = emscon.encode(EmsconRequest(Command.SET_UNITS, UNITS))
    with pytest.raises(WireError, match="Units has 24 bytes, 20 are expected"):
        emscon.from_client()(struct.pack("<i", len(data) + 4) + data[4:] + bytes(4))
    with pytest.raises(WireError, match="type 8 from a client"):
        emscon.from_client()(emscon.encode(said.StatusChange(1)))


def test_texts_fit_their_field_and_end_at_their_first_nul():
    with pytest.raises(ValueError, match="more than 31"):
        said.encode_body(said.ReflectorEntry(1, 1, 1, 0.0, "x" * 32))
    packet = bytearray(said.encode_body(said.ReflectorEntry(1, 1, 1, 0.0, "CCR")))
    packet[20 + 2 * 5 : 20 + 2 * 6] = b"\x00\xd8"  # half a surrogate pair, behind the end
    assert said.decode_body(said.ReflectorEntry, bytes(packet)).name == "CCR"
