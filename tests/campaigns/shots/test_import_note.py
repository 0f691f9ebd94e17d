"""Air and time of imported shots are kept in words, and read out of them again."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaigns.shots.shots import import_note, read_note

AIRS = st.none() | st.floats(allow_nan=False, allow_infinity=False)


@given(air=AIRS, time=st.none() | st.text())
def test_whatever_was_noted_is_read_again(air: float | None, time: str | None) -> None:
    assert read_note(import_note(air, time)) == (air, time)


@pytest.mark.parametrize(
    ("note", "said"),
    [
        ("imported", (None, None)),
        ("imported, measured 2025-01-01", (None, "2025-01-01")),  # as older journals have it
        ("imported, air 21.4 °C, measured noon, air 20 °C", (21.4, "noon, air 20 °C")),
        ("00000010 41.5", (None, None)),
    ],
)
def test_a_note_says_what_it_holds(note: str, said: tuple[float | None, str | None]) -> None:
    assert read_note(note) == said
