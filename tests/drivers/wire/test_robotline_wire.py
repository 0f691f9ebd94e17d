"""The grammar of robotline: what is written reads the same again, and garbage does no harm."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from robotline_layouts import PAR4_LAYOUT, PAR4_LINES, THREE_CARRIAGES

from drivers.errors import WireError
from drivers.wire import numbered_lines as lines
from drivers.wire import robotline as wire


def checksum_by_bits(data):
    """The checksum once more, as the specification describes it."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def checked(body):
    return b"%s *%04X" % (body, checksum_by_bits(body))


numbers = st.floats(allow_nan=False, allow_infinity=False)
speeds = st.floats(min_value=0.0, exclude_min=True, max_value=100.0)
sequences = st.integers(1, lines.LAST_SEQUENCE)
arms = st.integers(0, 3)
joints = st.tuples(*[numbers] * 4)
names = st.text(max_size=5).filter(str.isprintable)
part_names = st.sampled_from(list(PAR4_LAYOUT.parts))
parts = part_names.flatmap(
    lambda name: st.builds(
        wire.Part, st.just(name), st.tuples(*[numbers] * len(PAR4_LAYOUT.parts[name]))
    )
)
any_command = st.one_of(
    st.builds(wire.Hello, st.integers(0, 999)),
    st.builds(wire.MoveJoints, joints, speeds),
    st.builds(wire.MovePose, joints, speeds),
    st.builds(wire.ReadPart, part_names),
    parts,
    st.sampled_from([wire.Order.STATE, wire.Order.STOP]),
    st.sampled_from([wire.Order.COMMIT, wire.Order.ABANDON]),
)
any_outcome = st.one_of(
    st.tuples(
        st.just("HELLO"), st.builds(wire.ControllerGreeting, arms, names, names, names, names, arms)
    ),
    st.tuples(
        st.just("STATE"),
        st.builds(wire.ControllerStatus, st.booleans(), st.booleans(), names, joints),
    ),
    st.tuples(st.just("MOVEP"), st.builds(wire.MotionBegun, numbers)),
    st.tuples(st.just("GEOM"), parts),
    st.tuples(st.sampled_from(["STOP", "STAGE", "COMMIT"]), st.just(wire.CommandDone())),
)


def request_of(data):
    return PAR4_LINES.decode_request(data)


def reply_of(data):
    return PAR4_LINES.decode_reply(data)


@given(sequences, any_command)
def test_request_reads_as_it_was_written(sequence, command):
    request = wire.RobotlineRequest(sequence, command)
    written = PAR4_LINES.encode_request(request)
    assert written.endswith(b"\n")
    assert len(written) <= wire.LINE_BYTES
    assert request_of(written[:-1]) == request


@given(sequences, st.text(max_size=600))
def test_any_text_of_a_refusal_fits_into_a_line(sequence, text):
    written = PAR4_LINES.encode_reply(
        wire.RobotlineReply(sequence, "ABANDON", lines.Refused("GEOMETRY", text))
    )
    assert len(written) <= wire.LINE_BYTES
    assert reply_of(written[:-1]).outcome.code == "GEOMETRY"


@given(st.binary())
def test_checksum_is_the_one_that_is_specified(data):
    assert lines.checksum(data) == checksum_by_bits(data)


@given(numbers)
def test_number_reads_as_the_same_double(value):
    word = lines.number_word(value)
    assert "." in word
    assert repr(wire.Words([word], PAR4_LAYOUT).number("it")) == repr(value)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_number_that_is_not_finite_is_never_sent(value):
    with pytest.raises(WireError, match="not a finite number"):
        PAR4_LINES.encode_request(
            wire.RobotlineRequest(1, wire.MoveJoints((0.0, value, 0.0, 0.0), 10.0))
        )


def test_longest_lines_are_read_and_longer_ones_neither_read_nor_sent():
    room = wire.LINE_BYTES - len(b"<1 STOP NO FAULT  *0000\n")
    longest = checked(b"<1 STOP NO FAULT " + b"x" * room)
    assert reply_of(longest).outcome.code == "FAULT"
    with pytest.raises(WireError, match="more than 255 bytes"):
        reply_of(checked(b"<1 STOP NO FAULT " + b"x" * (room + 1)))
    with pytest.raises(WireError, match="limit is 255"):
        PAR4_LINES.encode_reply(
            wire.RobotlineReply(
                1, "STATE", wire.ControllerStatus(False, False, "x" * 300, (0.0,) * 4)
            )
        )


def test_number_of_a_question_starts_again_after_the_last():
    numbers = lines.sequence_from(lines.LAST_SEQUENCE - 1)
    assert [next(numbers) for _ in range(4)] == [lines.LAST_SEQUENCE - 1, lines.LAST_SEQUENCE, 1, 2]


def test_parameters_keep_their_names_through_the_parts():
    flat = {name: float(n) for n, name in enumerate(PAR4_LAYOUT.parameters)}
    assert len(flat) == 29
    again = {}
    for part in PAR4_LAYOUT.parts_of(flat):
        again |= PAR4_LAYOUT.flat(part)
    assert again == flat


def test_another_robot_has_other_words():
    """Three joints, no turn, and no parameter beside those of its arms."""
    moved = wire.RobotlineRequest(1, wire.MoveJoints((1.0, 2.0, 3.0), 50.0))
    carriages = wire.grammar(THREE_CARRIAGES)
    assert carriages.decode_request(PAR4_LINES.encode_request(moved)[:-1]) == moved
    with pytest.raises(lines.BadRequest):
        request_of(PAR4_LINES.encode_request(moved)[:-1])
    assert list(THREE_CARRIAGES.parts) == ["ARM 0", "ARM 1", "ARM 2"]
    with pytest.raises(lines.BadRequest, match="'PLATE' is neither ARM"):
        carriages.decode_request(
            PAR4_LINES.encode_request(wire.RobotlineRequest(1, wire.ReadPart("PLATE")))[:-1]
        )
    with pytest.raises(lines.BadRequest, match="not 0 to 2"):
        carriages.decode_request(
            PAR4_LINES.encode_request(wire.RobotlineRequest(1, wire.ReadPart("ARM 3")))[:-1]
        )


@given(sequences, any_outcome, st.binary())
def test_reply_reads_as_it_was_written_whatever_trails_behind_its_line(
    sequence, verb_and_outcome, trailing
):
    reply = wire.RobotlineReply(sequence, *verb_and_outcome)
    first, *_ = PAR4_LINES.line_framer().feed(PAR4_LINES.encode_reply(reply) + trailing)
    assert reply_of(first) == reply


@given(st.data())
def test_no_damage_of_two_bytes_goes_unseen(data):
    whole = bytearray(checked(b">103 MOVEJ 12.5 -7.25 0.0 90.0 25.0"))
    at = data.draw(st.integers(0, len(whole) - 2))
    damaged = bytes(whole[:at]) + data.draw(st.binary(min_size=2, max_size=2)) + whole[at + 2 :]
    if damaged != bytes(whole):
        with pytest.raises(lines.BadRequest):
            request_of(damaged)


def test_empty_lines_are_passed_over():
    assert PAR4_LINES.replies()(b"\n\r\n\n") == []
