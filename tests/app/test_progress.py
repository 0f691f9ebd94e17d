"""What a run and counted work show: a screen or bar on a terminal, a line each tenth elsewhere."""

import io
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime

import pytest
from rich.console import Console

from app.progress import CountedWork, interval
from app.run_screen import GOOD, RunLines, RunScreen, certainty, line_of, state_of, summary
from campaigns.measuring.run_state import EngineState, PositionUncertainty, Progress
from drivers.errors import RobotStateUnknown

AT_WORK = Progress(
    12, 59, EngineState.MEASURING, 12, "identification", (190.0, 310.0), 0.0123, 0.004
)
DONE = Progress(59, 59, EngineState.FINISHED, 58, "drift", None, 0.01, 0.002)
LOST = Progress(3, 9, EngineState.SUSPENDED, 3, "validation", beam_locked=False)
KNOWN = PositionUncertainty(40, "arm2.z_mm", 0.0214, 0.0061)
NOW = datetime(2026, 3, 2, 14, 30, tzinfo=UTC)


@pytest.mark.parametrize(
    ("say", "what", "text"),
    [
        (interval, (2.2, 2.4), "2 s"),
        (
            line_of,
            replace(AT_WORK, purpose="drift"),
            "12/59 · 3–5 min left · measuring drift 12 · residual 0.012 mm · drift 0.004 mm",
        ),
        (
            line_of,
            replace(AT_WORK, object="half 2", eta_s=None, drift_mm=None),
            "12/59 · measuring identification 12 (half 2) · residual 0.012 mm",
        ),
        (
            state_of,
            replace(AT_WORK, object="bed", purpose="height", counted="observation"),
            ("measuring observation 12 (height, bed)", GOOD),
        ),
        (certainty, KNOWN, "positions ±0.006 mm (1 σ) · weakest length arm2.z_mm ±0.021 mm"),
        (summary, DONE, "59 of 59 shots · finished · residual 0.010 mm · drift 0.002 mm"),
    ],
)
def test_what_is_known_is_said_and_nothing_else(say, what, text):
    assert say(what) == text


def console_of(*, is_terminal, width=80, height=24):
    stream = io.StringIO()
    console = Console(
        file=stream,
        width=width,
        height=height,
        force_terminal=is_terminal,
        force_interactive=is_terminal,
        color_system=None,
    )
    return console, stream


def screen_of(*states, events=(), size=(80, 24)):
    """Screen that was told these states."""
    console, _ = console_of(is_terminal=True, width=size[0], height=size[1])
    screen = RunScreen(console, "run")
    for state in states:
        screen.progress(state)
    for text in events:
        screen.event(text)
    return screen


def lines_on(screen, width=80):
    """Lines of the screen."""
    stream = io.StringIO()
    Console(file=stream, width=width, color_system=None).print(screen.picture(NOW))
    return [line.rstrip() for line in stream.getvalue().splitlines()]


def measured(residuals_mm):
    """States of a run that has measured shots with these residuals."""
    return [replace(AT_WORK, done=n, residual_mm=mm) for n, mm in enumerate((0.0, *residuals_mm))]


def test_the_screen_says_state_end_figures_and_keys():
    shots = measured((0.004, 0.006, 0.005, 0.004, 0.006, 0.0123))
    now = replace(AT_WORK, done=6, uncertainty=KNOWN, goal_mm=0.02)
    lines = lines_on(screen_of(*shots, now))
    assert lines[0] == "run: measuring shot 12 (identification)"
    assert lines[2:8] == [
        "6 of 59 shots · 53 left · ends between 14:33 and 14:35",
        "last residual 0.012 mm: good · drift 0.004 mm",
        certainty(KNOWN),
        "goal: positions to ±0.02 mm, now ±0.006 mm",
        "",
        "p pause · s skip shot · r redo pair · k park · q stop",
    ]


def test_a_lost_beam_comes_first_with_what_can_be_done():
    lines = lines_on(screen_of(replace(LOST, beam_lost_s=45.0, beam_advice="clear the way")))
    assert lines[0].startswith("run: the tracker lost the beam 45 s ago")
    assert lines[3:5] == ["clear the way", "s skips this shot"]


@pytest.mark.parametrize("size", [(40, 12), (80, 24)])
def test_the_screen_fits_and_breaks_no_word(size):
    events = ["shot 9, attempt 1: the robot moved while it was measured"] * 50
    lines = lines_on(
        screen_of(replace(AT_WORK, uncertainty=KNOWN), events=events, size=size), size[0]
    )
    assert all(len(line) <= size[0] for line in lines)
    assert {"(identification)", "weakest", "±0.006"} <= {*" ".join(lines).split()}
    assert len(lines) <= size[1] or size[0] < 80


@pytest.mark.parametrize(
    ("key", "state", "answer"),
    [
        ("s", EngineState.MEASURING, "s: this shot is skipped, unless it is measured already"),
        ("k", EngineState.PAUSED, "k: when it goes on"),
        ("x", EngineState.MOVING, "x: no such key"),
    ],
)
def test_a_key_is_answered_until_an_event_says_what_came_of_it(key, state, answer):
    screen = screen_of(replace(AT_WORK, state=state))
    screen.answer(key)
    assert answer in lines_on(screen)
    screen.event("it was done")
    assert answer not in lines_on(screen)


def test_what_happened_behind_the_screen_is_said_when_it_is_left():
    console, stream = console_of(is_terminal=True)
    with RunScreen(console, "run") as screen:
        screen.progress(AT_WORK)
        screen.event("the air has changed")
        with screen.paused():
            assert "! the air has changed" in stream.getvalue()
    assert stream.getvalue().rstrip().endswith(f"run: {summary(AT_WORK)}")


def lines_of(*states):
    """Lines of a run without a terminal."""
    console, stream = console_of(is_terminal=False)
    with RunLines(console, "run") as display:
        for state in states:
            display.progress(state)
    return stream.getvalue().splitlines()


def test_without_a_terminal_a_line_comes_every_tenth_of_the_work_and_at_the_end():
    states = [Progress(done, 40, EngineState.MOVING, done, "drift") for done in range(3, 14)]
    assert lines_of(*states) == [
        "run: 4/40 · moving drift 4",
        "run: 8/40 · moving drift 8",
        "run: 12/40 · moving drift 12",
        "run: 13 of 40 shots · moving",
    ]


def test_without_a_terminal_it_is_said_at_once_what_to_do_about_a_lost_beam():
    advice = "put the beam onto the robot's reflector by hand"
    lost = replace(LOST, beam_lost_s=45.0, beam_advice=advice)
    *told, _ = lines_of(LOST, lost, lost)
    assert told == [f"run: 3/9 · suspended validation 3 · BEAM LOST for 45 s · {advice}"]


def test_a_stop_that_was_not_confirmed_stands_first():
    console, stream = console_of(is_terminal=False)
    unknown = RobotStateUnknown("robot state unknown: no answer", remedy="use the hardware stop")
    with suppress(RobotStateUnknown), RunLines(console, "run") as display:
        display.progress(AT_WORK)
        raise unknown
    assert stream.getvalue().splitlines()[0] == "PRESS THE EMERGENCY STOP"


@pytest.mark.parametrize("is_terminal", [True, False])
def test_of_counted_work_there_is_a_bar_or_a_line_each_tenth(is_terminal):
    console, stream = console_of(is_terminal=is_terminal)
    with CountedWork(console, "campaigns", 100, done=10) as work:
        for _ in range(5):
            work.advance(6)
        work.news = "3 lost"
        work.advance(20)
    if is_terminal:
        assert "60/100" in stream.getvalue()
        assert "campaigns: " not in stream.getvalue()
    else:
        lines = ["22/100", "34/100", "40/100", "60/100 · 3 lost"]
        assert stream.getvalue().splitlines() == [f"campaigns: {line}" for line in lines]
