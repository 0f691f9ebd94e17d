"""Display of a run: a screen on a terminal, a line every tenth of the shots elsewhere."""

# The engine reports to a `RunObserver`: its state after each change (`progress`), and sentences
# about what happened (`event`). `RunLines` prints them; `RunScreen` keeps them, and draws a picture
# of the last state twice a second. The screen is the terminal's alternate one: when it is left, its
# contents are gone, so the events are printed once more as lines. It is left for each question.

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime, timedelta
from statistics import median
from typing import Self

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text
from typing_extensions import override

from app.progress import interval, is_next_tenth, say
from campaigns.measuring.run_state import EngineState, PositionUncertainty, Progress, RunObserver
from drivers.errors import PRESS_THE_EMERGENCY_STOP, RobotStateUnknown
from drivers.texts import printable

GOOD, BAD, OPEN, QUIET = "bold green", "bold red", "bold yellow", "dim"
KEYS = "p pause · s skip shot · r redo pair · k park · q stop"
KEYS_IN_PAUSE = "p goes on · q stop"
STOP_KEY = "q"
ANSWERS = {
    "p": "p: it pauses after this pair",
    "s": "s: this shot is skipped, unless it is measured already",
    "r": "r: the last shot, of a pair the pair, is measured again after this pair",
    "k": "k: it parks after this pair",
    STOP_KEY: "q: it stops",
}
ANSWERS_IN_PAUSE = {"p": "p: it goes on", "s": "s: no shot is being taken", STOP_KEY: "q: it stops"}
LONGEST_BAR = 60
SKIP_AFTER_S = 10.0
"""Duration of a lost beam after which the screen says how to skip the shot."""
USUAL_RESIDUALS = 30
"""Number of last residuals whose median is the usual one."""
FEWEST_RESIDUALS = 5
"""Number of earlier residuals below which the next one is not judged."""
LARGE_TIMES_USUAL = 3.0
"""Ratio to the usual residual above which a residual is called large."""
STATE_WORDS = {
    EngineState.IDLE: "between two shots",
    EngineState.MOVING: "moving to",
    EngineState.SETTLING: "settling at",
    EngineState.MEASURING: "measuring",
    EngineState.SUSPENDED: "trying again:",
    EngineState.STOPPED: "stopped",
    EngineState.FINISHED: "finished",
}
STATES_WITHOUT_SHOT = {EngineState.IDLE, EngineState.STOPPED, EngineState.FINISHED}


class RunLines(RunObserver):
    """Run as lines: each tenth of the shots, events, the end; with `verbose` each state.

    With `shot_by_shot` each shot that counts has a line, for people who take them by hand.
    """

    has_screen = False

    def __init__(
        self, console: Console, title: str, *, verbose: bool = False, shot_by_shot: bool = False
    ) -> None:
        self._console, self._title, self._verbose = console, title, verbose
        self._shot_by_shot = shot_by_shot
        self._progress: Progress | None = None
        self._residuals_mm: deque[float] = deque(maxlen=USUAL_RESIDUALS)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: object, error: object, _trace: object) -> None:
        # The robot may still move, and no program can stop it: this line comes before all others.
        if isinstance(error, RobotStateUnknown):
            say(self._console, PRESS_THE_EMERGENCY_STOP, BAD)
        progress = self._progress
        if progress is not None:
            say(self._console, f"{self._title}: {summary(progress)}", QUIET)
            # a finished run's uncertainty is in the command's answer
            if progress.uncertainty is not None and progress.state is not EngineState.FINISHED:
                say(self._console, f"{self._title}: {certainty(progress.uncertainty)}", QUIET)

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Leave the terminal to a question for the time of the block."""
        yield

    def answer(self, key: str) -> None:
        """Acknowledge a key; without a screen no keys are read."""

    def progress(self, progress: Progress) -> None:
        """Print the state if another tenth is done, or if there is new advice for the operator."""
        before = self._take(progress)
        if self._shot_by_shot and progress.done > before.done:
            say(self._console, shot_line(progress, [*self._residuals_mm]), GOOD)
            return
        is_due = is_next_tenth(before.done, progress.done, progress.total)
        is_advice = bool(progress.beam_advice) and progress.beam_advice != before.beam_advice
        if self._verbose or is_due or is_advice:
            say(self._console, f"{self._title}: {line_of(progress)}", QUIET)

    def event(self, text: str) -> None:
        """Print a sentence about what happened."""
        say(self._console, f"! {text}", "yellow")

    def announce(self, text: str) -> None:
        """Say what the operator has to do now."""
        say(self._console, text, OPEN)

    def _take(self, progress: Progress) -> Progress:
        """Keep the latest state and its residual; return the state before."""
        before, self._progress = self._progress or progress, progress
        if progress.done > before.done and progress.residual_mm is not None:
            self._residuals_mm.append(progress.residual_mm)
        return before


class RunScreen(RunLines):
    """Run on a screen of its own; events are printed as lines when the screen is left."""

    has_screen = True

    def __init__(self, console: Console, title: str) -> None:
        super().__init__(console, title)
        self._events: list[str] = []
        self._answer = ""
        self._live = Live(
            console=console, screen=True, refresh_per_second=2, get_renderable=self.picture
        )

    @override
    def __enter__(self) -> Self:
        self._live.start()
        return self

    @override
    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self._leave()
        super().__exit__(kind, error, trace)

    @override
    @contextmanager
    def paused(self) -> Iterator[None]:
        self._leave()
        try:
            yield
        finally:
            self._live.start()

    @override
    def answer(self, key: str) -> None:
        """Show what a key will do, until the next event shows what it did."""
        is_paused = self._progress is not None and self._progress.state is EngineState.PAUSED
        if is_paused and key in ANSWERS:
            self._answer = ANSWERS_IN_PAUSE.get(key, f"{key}: when it goes on")
        else:
            self._answer = ANSWERS.get(key, f"{printable(key)}: no such key")

    @override
    def progress(self, progress: Progress) -> None:
        before = self._take(progress)
        if progress.done > before.done:
            self._answer = ""  # what was announced for the shot before is done

    @override
    def announce(self, text: str) -> None:
        self._answer = text

    @override
    def event(self, text: str) -> None:
        self._answer = ""
        self._events.append(text)

    def picture(self, now: datetime | None = None) -> Group:
        """Return what is on the screen: state, bar, shots, figures, keys, events."""
        progress = self._progress
        if progress is None:
            return Group(Text(f"{self._title}: connecting", OPEN))
        state, style = state_of(progress)
        width = min(self._console.width, LONGEST_BAR)
        filled = width * progress.done // max(progress.total, 1)
        bar = Text.assemble(("━" * filled, "green"), ("┄" * (width - filled), QUIET))
        facts = [
            Text(shots_and_end(progress, now or datetime.now())),  # noqa: DTZ005 - as on the wall
            *(Text(text, QUIET) for text in figure_lines(progress, [*self._residuals_mm])),
            *(Text(printable(text), OPEN) for text in what_to_do(progress)),
        ]
        keys = KEYS_IN_PAUSE if progress.state is EngineState.PAUSED else KEYS
        # five rows for state, bar, blank, keys and answer, and two to spare for lines that wrap
        room = max(self._console.height - len(facts) - 7, 1)
        events = [Text(printable(text), "yellow") for text in self._events[-room:]]
        return Group(
            Text(f"{self._title}: {state}", style),
            bar,
            *facts,
            Text(),
            Text(keys, "reverse"),
            Text(self._answer, OPEN),
            *events,
        )

    def _leave(self) -> None:
        self._live.stop()
        for text in self._events:
            say(self._console, f"! {text}", "yellow")
        self._events.clear()


def line_of(progress: Progress) -> str:
    """Return the state in a line: `97/163 · 3–5 min left · moving drift 97 · residual …`."""
    parts = [f"{progress.done}/{progress.total}"]
    if progress.eta_s is not None:
        parts.append(f"{interval(progress.eta_s)} left")
    has_shot = progress.shot is not None and progress.state not in STATES_WITHOUT_SHOT
    on = f" ({progress.object})" if progress.object else ""
    if progress.state is not EngineState.IDLE:  # between two shots the next figures say all
        shot = f" {progress.purpose} {progress.shot}{on}" if has_shot else ""
        parts.append(f"{progress.state.value}{shot}")
    parts += _residual_and_drift(progress)
    if not progress.beam_locked:
        lost_s = progress.beam_lost_s
        parts.append(f"BEAM LOST for {interval((lost_s, lost_s))}" if lost_s else "BEAM LOST")
    if progress.beam_advice:
        parts.append(progress.beam_advice)
    if progress.goal_mm is not None:
        parts.append(_goal(progress))
    if progress.uncertainty is not None:
        parts.append(certainty(progress.uncertainty))
    return " · ".join(parts)


def shot_line(progress: Progress, residuals_mm: list[float]) -> str:
    """Return the line of a shot that counts: `shot 3: residual 0.040 mm, good · 3 of 55`."""
    judged = "accepted"
    if progress.residual_mm is not None:
        words = _judge_last(residuals_mm) or "accepted"
        judged = f"residual {progress.residual_mm:.3f} mm, {words}"
    return f"{progress.counted} {progress.shot}: {judged} · {progress.done} of {progress.total}"


def summary(progress: Progress) -> str:
    """Return shots done and last figures of a run that is over."""
    shots = f"{progress.done} of {progress.total} {progress.counted}s"
    return " · ".join([shots, progress.state.value, *_residual_and_drift(progress)])


def state_of(progress: Progress) -> tuple[str, str]:
    """Return the state in words, and its colour."""
    if not progress.beam_locked:
        lost_s = progress.beam_lost_s
        ago = f" {interval((lost_s, lost_s))} ago" if lost_s else ""
        return f"the tracker lost the beam{ago}", BAD
    if progress.state is EngineState.PAUSED:
        return "paused, the robot stands still", OPEN
    state = STATE_WORDS[progress.state]
    if progress.state in STATES_WITHOUT_SHOT or progress.shot is None:
        return state, BAD if progress.state is EngineState.STOPPED else GOOD
    style = OPEN if progress.state is EngineState.SUSPENDED else GOOD
    what = ", ".join(filter(None, (progress.purpose, progress.object)))
    return f"{state} {progress.counted} {progress.shot} ({what})", style


def shots_and_end(progress: Progress, now: datetime) -> str:
    """Return shots and the end by the clock: `34 of 163 shots · 129 left · ends at 14:32`."""
    remaining = progress.total - progress.done
    shots = f"{progress.done} of {progress.total} {progress.counted}s · {remaining} left"
    if progress.eta_s is None or not remaining:
        return shots
    low, high = (f"{now + timedelta(seconds=s):%H:%M}" for s in progress.eta_s)
    return f"{shots} · ends {f'at {low}' if low == high else f'between {low} and {high}'}"


def figure_lines(progress: Progress, residuals_mm: list[float]) -> Iterator[str]:
    """Yield the screen's lines of figures: last residual, judged, with drift; uncertainty; goal."""
    parts = _residual_and_drift(progress)
    if progress.residual_mm is not None:
        judged = _judge_last(residuals_mm)
        parts[0] = f"last {parts[0]}{judged and f': {judged}'}"
    if parts:
        yield " · ".join(parts)
    if progress.uncertainty is not None:
        yield certainty(progress.uncertainty)
    if progress.goal_mm is not None:
        yield _goal(progress)


def certainty(uncertainty: PositionUncertainty) -> str:
    """Return `positions ±0.006 mm (1 σ) · weakest length arm2.z_mm ±0.021 mm`."""
    positions = f"positions ±{uncertainty.position_std_mm:.3f} mm (1 σ)"
    if not uncertainty.weakest:
        return positions
    return (
        f"{positions} · weakest length {uncertainty.weakest} ±{uncertainty.weakest_std_mm:.3f} mm"
    )


def what_to_do(progress: Progress) -> Iterator[str]:
    """Yield what the operator can do about a lost beam; nothing while the beam is there."""
    if progress.beam_advice:
        yield progress.beam_advice
    if not progress.beam_locked and progress.beam_lost_s >= SKIP_AFTER_S:
        yield "s skips this shot"


def _residual_and_drift(progress: Progress) -> list[str]:
    values = (("residual", progress.residual_mm), ("drift", progress.drift_mm))
    return [f"{name} {value:.3f} mm" for name, value in values if value is not None]


def _goal(progress: Progress) -> str:
    uncertainty = progress.uncertainty
    reached = "not known yet" if uncertainty is None else f"±{uncertainty.position_std_mm:.3f} mm"
    return f"goal: positions to ±{progress.goal_mm:g} mm, now {reached}"


def _judge_last(residuals_mm: list[float]) -> str:
    """Return whether the last residual is like those before it; "" for the first few."""
    # the median, because one bad shot must not make the next bad one look usual
    *before, last = residuals_mm or [0.0]
    if len(before) < FEWEST_RESIDUALS:
        return ""
    usual_mm = median(before)
    if last <= LARGE_TIMES_USUAL * usual_mm:
        return "good"
    return f"large, {usual_mm:.3f} mm is usual"
