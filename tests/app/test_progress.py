"""What a run and counted work show: a bar on a terminal, a line now and then elsewhere."""

import io
import threading
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from time import monotonic

import pytest
from rich.console import Console

from app.progress import CountedWork, RunDisplay, counted, interval, news, state_and_rate, summary
from app.run_screen import certainty, run_screen
from campaigns.measuring.run_state import EngineState, PositionUncertainty, Progress
from drivers.errors import RobotStateUnknown

AT_WORK = Progress(
    12, 59, EngineState.MEASURING, 12, "identification", (190.0, 310.0), 0.0123, 0.004
)


BEGUN = Progress(0, 59, EngineState.IDLE)
DONE = Progress(59, 59, EngineState.FINISHED, 58, "drift", None, 0.01, 0.002)
LOST = Progress(3, 9, EngineState.SUSPENDED, 3, "validation", beam_locked=False)
KNOWN = PositionUncertainty(40, "arm2.z_mm", 0.0214, 0.0061)


def pace(numbers):
    return state_and_rate(*numbers)


TOLD = [
    (interval, (20.0, 35.0), "20–35 s"),
    (interval, (2.2, 2.4), "2 s"),
    (interval, (0.0, 0.2), "0 s"),
    (interval, (80.0, 119.0), "80–119 s"),
    (interval, (110.0, 130.0), "2 min"),
    (interval, (180.0, 240.0), "3–4 min"),
    (counted, AT_WORK, "12/59 · 3–5 min left"),
    (news, AT_WORK, "measuring identification 12 · residual 0.012 mm · drift 0.004 mm · beam ok"),
    (counted, BEGUN, "0/59"),
    (news, BEGUN, "idle · beam ok"),
    (news, LOST, "suspended validation 3 · BEAM LOST"),
    (news, replace(LOST, beam_lost_s=45.0), "suspended validation 3 · BEAM LOST for 45 s"),
    (news, replace(LOST, beam_lost_s=720.0), "suspended validation 3 · BEAM LOST for 12 min"),
    (certainty, KNOWN, "positions ±0.006 mm (1 σ) · weakest length arm2.z_mm ±0.021 mm"),
    (certainty, replace(KNOWN, weakest=""), "positions ±0.006 mm (1 σ)"),
    (summary, DONE, "59 of 59 shots · finished · residual 0.010 mm · drift 0.002 mm"),
    (pace, (120, 1000, 20, 1.0), "120/1000 · 100/s · 9 s left"),
    (pace, (4, 60, 0, 20.0), "4/60 · 12/min · 5 min left"),
    (pace, (20, 1000, 20, 3.0), "20/1000"),
    (pace, (0, 10, 0, 0.0), "0/10"),
    (pace, (10, 10, 0, 5.0), "10/10 · 2/s · 0 s left"),
]


@pytest.mark.parametrize(("say", "what", "text"), TOLD)
def test_what_is_known_is_told_and_nothing_else(say, what, text):
    assert say(what) == text


CERTAINTY = certainty(KNOWN)


def pictured(progress, width=80, height=24, residuals_mm=(), events=()):
    """Lines of the screen."""
    stream = io.StringIO()
    screen = run_screen("run", progress, residuals_mm, events, NOW, (width, height))
    Console(file=stream, width=width, color_system=None).print(screen)
    return [line.rstrip() for line in stream.getvalue().splitlines()]


NOW = datetime(2026, 3, 2, 14, 30, tzinfo=UTC)
RESIDUALS_MM = (0.004, 0.006, 0.005, 0.004, 0.006)


def test_the_screen_says_state_end_figures_and_keys():
    progress = replace(AT_WORK, known=KNOWN, goal_mm=0.02)
    lines = pictured(progress, residuals_mm=(*RESIDUALS_MM, 0.0123))
    assert lines[0] == "run: measuring shot 12 (identification)"
    assert lines[2:8] == [
        "12 of 59 shots · 47 left · ends between 14:33 and 14:35",
        "last residual 0.012 mm: good · drift 0.004 mm",
        CERTAINTY,
        "goal: positions to ±0.02 mm, now ±0.006 mm",
        "",
        "p pause · s skip this shot · r the last again · k park · q stop",
    ]


@pytest.mark.parametrize(
    ("residuals_mm", "words"),
    [
        ((*RESIDUALS_MM, 0.016), "last residual 0.012 mm: large, 0.005 mm is usual"),
        ((0.016,), "last residual 0.012 mm"),
    ],
)
def test_a_large_residual_is_called_so_once_others_tell_what_is_usual(residuals_mm, words):
    assert words in [line.split(" · ")[0] for line in pictured(AT_WORK, residuals_mm=residuals_mm)]


@pytest.mark.parametrize(
    ("progress", "first", "to_do"),
    [
        (replace(LOST, beam_lost_s=4.0), "run: the tracker lost the beam 4 s ago", None),
        (
            replace(LOST, beam_lost_s=45.0, beam_advice="clear the way"),
            "run: the tracker lost the beam 45 s ago",
            ["clear the way", "s skips this shot"],
        ),
        (replace(AT_WORK, state=EngineState.PAUSED), "run: paused, the robot stands still", None),
        (replace(AT_WORK, state=EngineState.SUSPENDED), "run: trying again: shot 12", None),
        (BEGUN, "run: between two shots", None),
        (None, "run: connecting", None),
    ],
)
def test_each_state_has_words_and_what_can_be_done(progress, first, to_do):
    lines = pictured(progress)
    assert lines[0].startswith(first)
    assert to_do is None or lines[3:5] == to_do


@pytest.mark.parametrize(("width", "height"), [(40, 12), (80, 24), (120, 40)])
def test_the_screen_fits_and_breaks_no_word(width, height):
    events = ["shot 9, attempt 1: the robot moved while it was measured"] * 50
    progress = replace(AT_WORK, known=KNOWN)
    lines = pictured(progress, width, height, RESIDUALS_MM, events)
    assert all(len(line) <= width for line in lines)
    words = " ".join(lines).split()
    assert {"(identification)", "weakest", "positions", "±0.006"} <= {*words}
    if width >= 80:
        assert len(lines) <= height


def test_what_is_known_is_told_at_the_end():
    display, stream, _ = display_on()
    with display:
        display.progress(replace(AT_WORK, known=KNOWN))
    assert stream.getvalue().splitlines()[-1] == f"run: {CERTAINTY}"


def test_what_to_do_about_a_lost_beam_stands_below_it_and_in_the_plain_line():
    lost = Progress(
        0,
        9,
        EngineState.SUSPENDED,
        0,
        "drift",
        beam_locked=False,
        beam_lost_s=45.0,
        beam_advice="put the beam onto the robot's reflector by hand",
    )
    display, stream, hands = display_on()
    with display:
        display.progress(replace(lost, beam_lost_s=1.0))
        hands.now_s = 31.0
        display.progress(lost)
    told = next(line for line in stream.getvalue().splitlines() if "45 s" in line)
    assert told.endswith("BEAM LOST for 45 s · put the beam onto the robot's reflector by hand")


class Hands:
    """A clock moved by hand."""

    def __init__(self):
        self.now_s = 0.0

    def __call__(self):
        return self.now_s


def screen(width, *, is_terminal, can_draw=True):
    stream, hands = io.StringIO(), Hands()
    console = Console(
        file=stream,
        width=width,
        force_terminal=is_terminal,
        force_interactive=is_terminal and can_draw,
        color_system=None,
    )
    return console, stream, hands


def display_on(*, width=80, is_terminal=False, verbose=False):
    console, stream, hands = screen(width, is_terminal=is_terminal)
    return RunDisplay(console, "run", now_s=hands, verbose=verbose), stream, hands


def lines_of(progress_at):
    """Lines of a run without a terminal, told its shots by the second."""
    display, stream, hands = display_on()
    with display:
        for hands.now_s, shots in progress_at:
            display.progress(Progress(shots, 59, EngineState.MOVING, shots, "drift"))
    return stream.getvalue().splitlines()


def test_without_a_terminal_a_line_comes_every_ten_shots_and_at_the_end():
    assert lines_of((second, second) for second in range(25)) == [
        "run: 10/59 · moving drift 10 · beam ok",
        "run: 20/59 · moving drift 20 · beam ok",
        "run: 24 of 59 shots · moving",
    ]


def test_without_a_terminal_a_line_comes_every_thirty_seconds_where_shots_take_long():
    assert lines_of((6 * shot, shot) for shot in range(8)) == [
        "run: 5/59 · moving drift 5 · beam ok",
        "run: 7 of 59 shots · moving",
    ]


def test_without_a_terminal_it_says_that_it_is_still_there_while_nothing_is_new(monkeypatch):
    monkeypatch.setattr("app.progress.QUIET_RUN_S", 0.01)
    stream = Awaited()
    console = Console(file=stream, color_system=None)
    with RunDisplay(console, "run", now_s=monotonic, verbose=False):
        assert stream.came.wait(10.0)
    assert stream.getvalue().startswith("run: connecting")


class Awaited(io.StringIO):
    """A text that somebody waits for."""

    def __init__(self):
        super().__init__()
        self.came = threading.Event()

    def write(self, text):
        self.came.set()
        return super().write(text)


def test_a_stop_that_was_not_confirmed_stands_first():
    display, stream, _ = display_on()
    unknown = RobotStateUnknown("robot state unknown: no answer", remedy="use the hardware stop")
    display.progress(AT_WORK)
    with suppress(RobotStateUnknown), display:
        raise unknown
    assert stream.getvalue().splitlines()[0] == "PRESS THE EMERGENCY STOP"
    assert str(unknown).startswith("PRESS THE EMERGENCY STOP: robot state unknown: ")


def test_verbose_tells_every_state():
    display, stream, _ = display_on(verbose=True)
    with display:
        display.progress(AT_WORK)
        display.progress(Progress(13, 59, EngineState.IDLE, 12, "identification"))
    assert [line[:10] for line in stream.getvalue().splitlines()] == [
        "12/59 meas",
        "13/59 idle",
        "run: 13 of",
    ]


def test_an_event_is_never_cut():
    display, stream, _ = display_on(width=20)
    display.event("the air has changed by +1.25 °C since the start [limit 1]")
    text = "! the air has changed by +1.25 °C since the start [limit 1]\n"
    assert stream.getvalue() == text


@pytest.mark.parametrize(
    ("key", "state", "answer"),
    [
        ("s", EngineState.MEASURING, "s: this shot is skipped, unless it is measured already"),
        ("p", EngineState.MOVING, "p: it pauses after this pair"),
        ("p", EngineState.PAUSED, "p: it goes on"),
        ("k", EngineState.PAUSED, "k: when it goes on"),
        ("x", EngineState.MOVING, "x: no such key"),
    ],
)
def test_a_key_is_answered_until_it_is_told_what_came_of_it(key, state, answer):
    display, _, _ = display_on(is_terminal=True)
    display.progress(replace(AT_WORK, state=state))
    told = []
    for act in (lambda: display.answer(key), lambda: display.event("it was heeded")):
        act()
        stream = io.StringIO()
        Console(file=stream, width=80, color_system=None).print(display.screen())
        told.append(answer in [line.rstrip() for line in stream.getvalue().splitlines()])
    assert told == [True, False]


def test_what_happened_behind_the_screen_is_told_when_it_is_left():
    display, stream, _ = display_on(is_terminal=True)
    with display:
        display.progress(AT_WORK)
        display.event("the air has changed")
        assert "! the air" not in stream.getvalue()
        with display.paused():
            assert "! the air has changed" in stream.getvalue()
    assert stream.getvalue().count("! the air has changed") == 1
    assert "run: 12 of 59 shots" in stream.getvalue()


def test_a_plain_run_has_no_screen_on_a_terminal():
    console, stream, hands = screen(200, is_terminal=True)
    display = RunDisplay(console, "run", now_s=hands, verbose=False, plain=True)
    with display:
        for shots in range(0, 30, 10):
            display.progress(replace(AT_WORK, done=shots))
    assert not display.has_screen
    assert [line[:9] for line in stream.getvalue().splitlines()] == [
        "run: 10/5",
        "run: 20/5",
        "run: 20 o",
    ]


def test_a_run_that_never_began_says_nothing_at_its_end():
    display, stream, _ = display_on()
    with display:
        pass
    assert stream.getvalue() == ""


def counted_on(*, is_terminal, can_draw=True, width=80):
    console, stream, hands = screen(width, is_terminal=is_terminal, can_draw=can_draw)
    work = CountedWork(console, "campaigns", 100, done=10, now_s=hands, quiet_s=2.0)
    return work, stream, hands


def test_of_counted_work_a_line_comes_now_and_then():
    work, stream, hands = counted_on(is_terminal=False)
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
    work, stream, hands = counted_on(is_terminal=True, can_draw=False)
    with work:
        hands.now_s = 2.0
        work.advance(10)
    assert stream.getvalue() == "campaigns: 20/100 · 5/s · 16 s left\n"


@pytest.mark.parametrize("width", [60, 80])
def test_of_counted_work_there_is_a_bar_and_no_line(width):
    work, stream, hands = counted_on(is_terminal=True, width=width)
    hands.now_s = 9.0
    work.advance(45)
    assert stream.getvalue() == ""
    Console(file=stream, width=width, color_system=None).print(work._bars)
    (row,) = stream.getvalue().splitlines()
    assert row.startswith("campaigns ━━━")
    assert row.rstrip().endswith("55/100 · 5/s · 9 s left")
