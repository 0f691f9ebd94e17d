"""Work that is counted: how far, how fast, how long still; a bar, or a line now and then."""

import io

import pytest
from rich.console import Console

from app.progress import CountedWork, Pace


@pytest.mark.parametrize(
    ("pace", "text"),
    [
        (Pace(120, 1000, 20, 1.0), "120/1000 · 100/s · 9 s left"),
        (Pace(4, 60, 0, 20.0), "4/60 · 12/min · 5 min left"),
        (Pace(20, 1000, 20, 3.0), "20/1000"),
        (Pace(0, 10, 0, 0.0), "0/10"),
        (Pace(10, 10, 0, 5.0), "10/10 · 2/s · 0 s left"),
    ],
)
def test_pace_counts_what_was_done_since_the_beginning(pace, text):
    assert str(pace) == text


class Hands:
    """A clock moved by hand."""

    def __init__(self):
        self.now_s = 0.0

    def __call__(self):
        return self.now_s


def counted(*, is_terminal, can_draw=True, width=80):
    stream, hands = io.StringIO(), Hands()
    console = Console(
        file=stream,
        width=width,
        force_terminal=is_terminal,
        force_interactive=is_terminal and can_draw,
        color_system=None,
    )
    work = CountedWork(console, "campaigns", 100, done=10, now_s=hands, quiet_s=2.0)
    return work, stream, hands


def test_without_a_terminal_a_line_comes_now_and_then():
    work, stream, hands = counted(is_terminal=False)
    with work:
        for _ in range(5):
            hands.now_s += 1.0
            work.advance(10)
        work.news = "3 lost"
        hands.now_s += 1.0
        work.advance(10)
    assert stream.getvalue().splitlines() == [
        "campaigns: 30/100 · 10/s · 7 s left",
        "campaigns: 50/100 · 10/s · 5 s left",
        "campaigns: 70/100 · 10/s · 3 s left · 3 lost",
    ]


def test_on_a_terminal_that_cannot_draw_the_lines_come_too():
    work, stream, hands = counted(is_terminal=True, can_draw=False)
    with work:
        hands.now_s = 2.0
        work.advance(10)
    assert stream.getvalue() == "campaigns: 20/100 · 5/s · 16 s left\n"


@pytest.mark.parametrize("width", [60, 80])
def test_on_a_terminal_there_is_a_bar_and_no_line(width):
    work, stream, hands = counted(is_terminal=True, width=width)
    hands.now_s = 9.0
    work.advance(45)
    assert stream.getvalue() == ""
    Console(file=stream, width=width, color_system=None).print(work._bars)
    (row,) = stream.getvalue().splitlines()
    assert row.startswith("campaigns ━━━")
    assert row.rstrip().endswith("55/100 · 5/s · 9 s left")
