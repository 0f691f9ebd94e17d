"""The byte log: every byte in its direction, readable, and errors of the wire passed on."""

import ast
import logging

import pytest
from hypothesis import given
from hypothesis import strategies as st
from timed_pipe import HandClock, TimedPipe

from drivers.byte_log import logged, readable
from drivers.errors import LinkDown


def test_both_directions_and_failures_are_logged_and_passed_on(caplog):
    caplog.set_level(logging.DEBUG)
    pipe = TimedPipe(HandClock(), lambda _: [(0.1, b"pong\r\n")])
    transport = logged(lambda **_: pipe, "tracker")()
    transport.send(b"ping\r\n", 1.0)
    assert transport.receive(1.0) == b"pong\r\n"
    assert transport.receive(1.0) == b""
    transport.close()
    with pytest.raises(LinkDown):
        transport.receive(1.0)
    assert pipe.sent == [b"ping\r\n"]
    assert caplog.messages == [
        r"tracker > 'ping\r\n'",
        r"tracker < 'pong\r\n'",
        "tracker ! pipe://test: closed",
    ]


@given(st.binary(max_size=60))
def test_no_byte_is_lost_and_every_line_can_be_printed(data):
    shown = readable(data)
    assert shown.isprintable()
    read = ast.literal_eval(shown).encode() if shown[:1] in {"'", '"'} else bytes.fromhex(shown)
    assert read == data
