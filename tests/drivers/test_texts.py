"""Texts of devices and files: nothing hidden in them is shown."""

import os
import subprocess
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import DeviceRefused
from drivers.texts import printable, quoted

ANY_SIGN = st.characters(codec=None)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("AT403 \u2013 390793", "AT403 \u2013 390793"),
        ("20\u202f°C, 5\u00a0mm", "20\u202f°C, 5\u00a0mm"),
        ("Großmann 王 مهدی\u200cزاده", "Großmann 王 مهدی\u200cزاده"),
        ("\x1b[2Jgone", "?[2Jgone"),
        ("one\r\ntwo\tthree\u2028four\x85five", "one  two three four five"),
        ("par4\u202egpj.exe\u2066", "par4?gpj.exe?"),
        ("\ud800 \x00 \x9b \x7f \ufeff", "? ? ? ? ?"),
    ],
)
def test_hidden_characters_are_replaced_and_all_others_stay(text, shown):
    assert printable(text) == shown


@given(st.text(ANY_SIGN, max_size=80))
def test_what_is_shown_is_one_line_that_any_terminal_can_take(text):
    shown = printable(text)
    assert len(shown) == len(text)
    assert len(shown.splitlines()) <= 1
    assert printable(shown) == shown
    shown.encode("utf-8")
    assert not {unicodedata.category(sign) for sign in shown} & {"Cc", "Cs", "Zl", "Zp"}


def test_an_error_is_one_clean_line_of_bounded_length_with_its_remedy():
    said = str(DeviceRefused("name \x1b[2J\n" + "x" * 5_000_000 + " end", remedy="look\u202e"))
    assert said.startswith("name ?[2J ")
    assert said.endswith(" end → look?")
    assert len(said) < 1000


@pytest.mark.parametrize("name", [b"cell 7", b"M\xfcller's (2)/c", b"a\x1bb", "Müller".encode()])
def test_a_quoted_name_is_typed_as_it_is_and_can_be_shown(name):
    word = quoted(os.fsdecode(name))
    assert word.isprintable()
    typed = subprocess.run(["bash", "-c", f"printf %s {word}"], capture_output=True, check=True)
    assert typed.stdout == name
