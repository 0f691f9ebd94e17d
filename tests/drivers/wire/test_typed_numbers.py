"""Numbers that a person types or pastes: any separators, decimal commas, nothing guessed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import WireError
from drivers.wire.typed_numbers import typed_numbers

POINT = (2510.5, -35.25, 75.0)


@pytest.mark.parametrize(
    "text",
    [
        "2510.5 -35.25 75.0",
        "  2510.5\t-35.25\t75 ",
        "2510.5,-35.25,75.0",
        "2510,5 -35,25 75,0",
        "2510,5; -35,25; 75",
        "2510,5, -35,25, 75,0",
        "X = 2510.5 Y = -35.25 Z = 75.0 mm",
        "x 2510.5 mm; y \u221235.25 mm; z +75 mm",
        "X:2.5105e3 Y:-3.525E1 Z:7.5e1",
    ],
)
def test_point_is_read_however_it_is_separated(text):
    assert typed_numbers(text, 3) == POINT


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "0 numbers, 3 are needed"),
        ("1 2 3 4", "4 numbers, 3 are needed"),
        ("2510,5,-35,25,75,0", "is no number"),
        ("2.510,5 1,5 75,0", "is no number"),
        ("2510,5 -35.25 75", "decimal commas and decimal points"),
        ("nan 1 2", "'nan' .* is no number"),
        ("1e999 1 2", "too large"),
        ("P1 2510.5 -35.25 75", "'P1' .* is no number"),
    ],
)
def test_line_that_is_no_point_is_refused_with_what_to_type(text, said):
    with pytest.raises(WireError, match=said) as refused:
        typed_numbers(text, 3)
    assert "decimal points" in refused.value.remedy


@given(st.text(max_size=40), st.integers(1, 6))
def test_any_text_is_so_many_finite_numbers_or_refused(text, count):
    try:
        values = typed_numbers(text, count)
    except WireError:
        return
    assert len(values) == count
    assert all(abs(value) < float("inf") for value in values)


@given(st.lists(st.floats(-1e5, 1e5), min_size=3, max_size=3))
def test_what_is_shown_reads_the_same_when_it_is_typed(values):
    shown = " ".join(f"{value:.4f}" for value in values)
    assert typed_numbers(shown, 3) == pytest.approx(values, abs=5.1e-5)
    assert typed_numbers(shown.replace(".", ","), 3) == typed_numbers(shown, 3)
