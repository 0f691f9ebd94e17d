"""Lines of bounded length, however their bytes are cut."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.wire.framing import LineFramer

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
        (b"whole\n", [b"whole"]),
        (b"whole\r\n", [b"whole"]),
        (b"a\rb\r\r\n", [b"a\rb\r"]),
        (b"one\ntwo\nthr", [b"one", b"two"]),
        (b"\n\n", [b"", b""]),
        (b"12345678\n", [b"12345678"]),
        (b"1234567\r\n", [b"1234567"]),
        (b"123456789\n", [b"123456789"]),
        (b"1234567890 and more\nnext\n", [b"123456789", b"next"]),
        (b"12345678\r\nnext\n", [b"12345678\r", b"next"]),
    ],
)
def test_stream_is_cut_into_lines(stream, lines):
    assert lines_of([stream]) == lines
    assert lines_of([bytes([byte]) for byte in stream]) == lines


def test_line_that_is_too_long_is_told_before_it_ends():
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


@given(st.lists(st.binary()))
def test_no_line_and_no_remainder_is_longer_than_the_limit_and_one(pieces):
    framer = LineFramer(LIMIT)
    for piece in pieces:
        assert all(len(line) <= LIMIT + 1 for line in framer.feed(piece))
        assert len(framer._partial) <= LIMIT + 1
