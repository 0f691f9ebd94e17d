"""linuxcncrsh's lines: what is taken apart, what is refused, what is never sent."""

import pytest

from drivers.errors import WireError
from drivers.wire import linuxcncrsh as wire

SESSION = (
    b"HELLO ACK PAR4 1.1\r\nset echo off\nSET VERBOSE ACK\n\rSET TIMEOUT NAK\n\r"
    b"JOINT_POS 12.345679 -23.456789 34.567891 45.678912 0.000000 0.000000\r\n"
    b"GET NONSENSE NAK\r\n\r\nERROR joint 3 following error\r\n"
    b"error: Subcommand not found: SET SET_WAIT\r\nSET NAK\r\n"
)
MESSAGES = [
    wire.LinuxcncGreeting(True, "PAR4", "1.1", "HELLO ACK PAR4 1.1"),
    wire.Remark("set echo off"),
    wire.Verdict("SET", "VERBOSE", True, "SET VERBOSE ACK"),
    wire.Verdict("SET", "TIMEOUT", False, "SET TIMEOUT NAK"),
    wire.Value(
        "JOINT_POS",
        "12.345679 -23.456789 34.567891 45.678912 0.000000 0.000000",
        "JOINT_POS 12.345679 -23.456789 34.567891 45.678912 0.000000 0.000000",
    ),
    wire.Verdict("GET", "NONSENSE", False, "GET NONSENSE NAK"),
    wire.Value("ERROR", "joint 3 following error", "ERROR joint 3 following error"),
    wire.Remark("error: Subcommand not found: SET SET_WAIT"),
    wire.Verdict("SET", "", False, "SET NAK"),
]


def test_session_of_old_and_newer_versions_is_taken_apart():
    assert wire.answers()(SESSION) == MESSAGES


@pytest.mark.parametrize(
    "blank", ["", " ", "\t \x0b\x0c", "\x1c\x1d\x1e\x1f", "\x85", "\xa0\u2003"]
)
def test_line_of_white_space_only_says_nothing(blank):
    line = f"{blank}\r\n".encode()
    assert wire.answers()(line + b"SET NAK\r\n") == [wire.Verdict("SET", "", False, "SET NAK")]


def test_lines_of_their_own_are_values_or_remarks():
    assert wire.read_message(b"Exceeded the limit") == wire.Remark("Exceeded the limit")
    assert wire.read_message(b"CONFIG") == wire.Value("CONFIG", "", "CONFIG")
    assert wire.read_message(b"HELLO NAK") == wire.LinuxcncGreeting(False, "", "", "HELLO NAK")


@pytest.mark.parametrize("line", [b"HELLO", b"HELLO ACK PAR4", b"HELLO YOU THERE 1"])
def test_other_greeting_is_none_of_linuxcncrsh(line):
    with pytest.raises(WireError, match="none of linuxcncrsh"):
        wire.read_message(line)


def test_answer_longer_than_any_is_refused_before_it_ends():
    with pytest.raises(WireError, match="in one line"):
        wire.answers()(b"ERROR " + b"x" * wire.LONGEST_ANSWER)


def test_message_for_the_operator_may_hold_a_tab_but_no_control_character():
    assert wire.read_message(b"ERROR a\tb") == wire.Value("ERROR", "a b", "ERROR a b")
    with pytest.raises(WireError, match="no text"):
        wire.read_message(b"ERROR a\x1bb")


def test_requests_become_lines_of_at_most_255_bytes():
    assert wire.encode("set mdi G53 G0 X1.000000") == b"set mdi G53 G0 X1.000000\n"
    assert len(wire.encode("x" * 254)) == 255
    with pytest.raises(WireError, match="256 bytes, at most 255 are safe"):
        wire.encode("x" * 255)


@pytest.mark.parametrize(
    "request_", ["", "get error\nset estop on", "get\rerror", "get é", "a\x00b"]
)
def test_request_that_would_arrive_as_another_is_never_sent(request_):
    with pytest.raises(WireError, match="cannot be sent"):
        wire.encode(request_)


@pytest.mark.parametrize("password", ["secrét", "secret" * 50])
def test_password_that_cannot_be_sent_is_not_told(password):
    with pytest.raises(WireError) as error:
        wire.encode(f"hello {password} client 1.1")
    assert "secr" not in str(error.value)


@pytest.mark.parametrize("text", ["1 2 x", "1 nan", "inf", "1,5", "1_0", "١٢", "1e400"])
def test_numbers_that_are_none_are_refused(text):
    with pytest.raises(WireError):
        wire.read_numbers(wire.Value("JOINT_POS", text, f"JOINT_POS {text}"))


def test_numbers_are_read():
    assert wire.read_numbers(wire.Value("JOINT_POS", "1.5 -0.000000", "-")) == (1.5, -0.0)
