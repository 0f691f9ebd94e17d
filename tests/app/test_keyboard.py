"""Faults of a terminal: answers typed ahead, closed terminals, foreign escape sequences."""

import os
import pty
import threading
import time

import pytest

from app.keyboard import Keyboard
from drivers.errors import LinkDown

SOON_S = 5.0


@pytest.fixture
def hand(monkeypatch):
    """The end of a terminal at which somebody types; the other end is stdin."""
    hand, program = pty.openpty()
    stdin = os.fdopen(program, "r")
    monkeypatch.setattr("sys.stdin", stdin)
    monkeypatch.setattr("app.keyboard._in_foreground", lambda: True)
    yield hand
    stdin.close()
    os.close(hand)


def heard(hand, typed):
    """Return the keys that are heard of what is typed, up to the last one, a dot."""
    keys, over = [], threading.Event()

    def pressed(key):
        keys.append(key)
        if key == ".":
            over.set()

    with Keyboard().keys(pressed):
        for piece in (*typed, b"."):
            os.write(hand, piece)
            time.sleep(0.05)
        assert over.wait(SOON_S)
    return "".join(keys[:-1])


def test_an_answer_typed_before_the_question_is_lost(hand):
    os.write(hand, b"y\ny")
    time.sleep(0.05)
    assert Keyboard().line(lambda: os.write(hand, b"n\n")) == "n"


def test_keys_heard_before_a_question_are_no_part_of_its_answer(hand):
    keyboard, keys = Keyboard(), []
    with keyboard.keys(keys.append):
        os.write(hand, b"p")
        while keys != ["p"]:
            time.sleep(0.01)
        assert keyboard.line(lambda: os.write(hand, b"yes\n")) == "yes"
        os.write(hand, b"s")
        while keys != ["p", "s"]:
            time.sleep(0.01)


@pytest.mark.parametrize("length", [0, 5000], ids=["closed", "endless"])
def test_a_terminal_that_gives_no_line_is_an_error_and_not_a_wait(monkeypatch, length):
    reader, writer = os.pipe()
    os.write(writer, b"y" * length)
    os.close(writer)
    with os.fdopen(reader) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        with pytest.raises(LinkDown, match="the terminal was closed"):
            Keyboard().line(lambda: None)


def test_a_terminal_that_closes_ends_the_keys(monkeypatch):
    hand, program = pty.openpty()
    with os.fdopen(program) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        monkeypatch.setattr("app.keyboard._in_foreground", lambda: True)
        with Keyboard().keys(lambda key: None):
            os.close(hand)
    assert "keys" not in [thread.name for thread in threading.enumerate()]


@pytest.mark.parametrize(
    "sequence",
    [b"\x1bOq", b"\x1bq", b"\x1b[?1;2c", b"\x1b", b"\xc3\x28"],
    ids=["keypad 1", "Alt-q", "identity", "Esc", "no UTF-8"],
)
def test_no_letter_of_an_escape_sequence_is_a_key(hand, sequence):
    assert heard(hand, [b"p", sequence, b"s"]).replace("(", "") == "ps"
