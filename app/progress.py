"""Progress of a work, told the way the screen can take it: a bar, or a line now and then."""

import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from typing import Self

from rich.console import Console, RenderableType
from rich.live import Live
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bars
from rich.text import Text

from app.run_screen import answer_to, certainty, run_screen
from campaigns.measuring.run_state import EngineState, Progress, RunObserver
from drivers.errors import PRESS_THE_EMERGENCY_STOP, RobotStateUnknown
from drivers.texts import printable

QUIET_S = 10.0
"""Without a terminal a line is printed every so many seconds."""
QUIET_RUN_S = 30.0
QUIET_SHOTS = 10
"""Of a run the same: after so many seconds, also while one thing is waited for, or shots."""
BAR_WIDTH = 30
USUAL_RESIDUALS = 30
"""Last residuals by which the next is called good or large."""
REDRAWN_S = 0.25
"""Each drawing takes its time from the work."""
SHORTEST_S = 0.1
MINUTE_S = 60.0


class CountedWork:
    """A bar on a terminal while the block runs, now and then a line where there is none.

    Its text is `str` of it, asked for whenever the bar is drawn: by a thread of its own.
    """

    def __init__(
        self,
        console: Console,
        what: str,
        total: int,
        *,
        done: int = 0,
        now_s: Callable[[], float],
        quiet_s: float = QUIET_S,
    ) -> None:
        self._console, self._now_s, self._quiet_s = console, now_s, quiet_s
        self._what, self._total = what, total
        self._before = self._done = done
        self._began_s = self._told_s = now_s()
        self._bars = _Bars(console)
        self._bar = self._bars.add_task(what, total=max(total, 1), completed=done, text=self)
        self.news = ""
        """Words behind the numbers."""

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._bars.stop()

    def __str__(self) -> str:
        seconds = self._now_s() - self._began_s
        pace = state_and_rate(self._done, self._total, self._before, seconds)
        return " · ".join(filter(None, [pace, self.news]))

    def advance(self, more: int = 1) -> None:
        """So many more are done; where there is no bar, a line now and then says so."""
        self._done += more
        self._bars.update(self._bar, completed=self._done)
        if self._bars.disable and self._now_s() - self._told_s >= self._quiet_s:
            self._told_s = self._now_s()
            self.say(f"{self._what}: {self}")

    def say(self, text: str, style: str = "dim") -> None:
        """Print a line that stays, above the bar."""
        line = Text(printable(text), style)  # the style is not the bar's
        self._console.print(line, soft_wrap=True)


class _Bars(Bars):
    """A title, its bar and its text in one row that is never wrapped."""

    def __init__(self, console: Console) -> None:
        super().__init__(
            TextColumn("{task.description}", style="bold", markup=False),
            BarColumn(BAR_WIDTH),
            TextColumn("{task.fields[text]}", markup=False),
            console=console,
            transient=True,
            refresh_per_second=4,  # each drawing takes its time from the work
            disable=not console.is_interactive,
        )


class RunDisplay(RunObserver):
    """The shots of a run: a screen of its own on a terminal, lines now and then elsewhere.

    `plain` asks for the lines on a terminal too; `verbose` tells every state of every shot. What
    happened meanwhile stays on the terminal when the screen is left.
    """

    def __init__(
        self,
        console: Console,
        title: str,
        *,
        now_s: Callable[[], float],
        verbose: bool,
        plain: bool = False,
        clock: Callable[[], datetime] = datetime.now,
    ) -> None:
        self._console, self._what, self._now_s, self._clock = console, title, now_s, clock
        self._verbose = verbose
        self._progress: Progress | None = None
        self._residuals_mm: deque[float] = deque(maxlen=USUAL_RESIDUALS)
        self._events: list[str] = []
        self._answer = ""
        self._began_s = self._told_s = now_s()
        self._told = 0
        self._turn = threading.Lock()
        self._over = threading.Event()
        self._heart = threading.Thread(target=self._beat, name="progress", daemon=True)
        self._live: Live | None = None
        self._shown: object = None
        if console.is_interactive and not plain and not verbose:
            self._live = Live(
                console=console, screen=True, auto_refresh=False, get_renderable=self.screen
            )

    @property
    def has_screen(self) -> bool:
        """Whether there is a screen, on which keys are named."""
        return self._live is not None

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        self._heart.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._over.set()
        if self._heart.ident is not None:
            self._heart.join()
        if self._live is not None:
            self._live.stop()
            self._say_events()
        if isinstance(error[1], RobotStateUnknown):
            self.say(PRESS_THE_EMERGENCY_STOP, "bold red")
        if self._progress is not None:
            known = () if self._progress.state is EngineState.FINISHED else _known(self._progress)
            for line in (summary(self._progress), *known):
                self.say(f"{self._what}: {line}")

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Time without the screen, or lines of its own, for questions and answers."""
        if self._live is None:
            with self._turn:
                yield
            return
        with self._turn:
            self._live.stop()
        self._say_events()
        try:
            yield
        finally:
            with self._turn:
                self._live.start()
                self._shown = None

    def screen(self) -> RenderableType:
        """What is drawn now."""
        now, size = self._clock(), (self._console.width, self._console.height)
        return run_screen(
            self._what,
            self._progress,
            tuple(self._residuals_mm),
            self._events,
            now,
            size,
            self._answer,
        )

    def answer(self, key: str) -> None:
        """Say what comes of a key, until an event says what did."""
        self._answer = answer_to(key, self._progress.state if self._progress else None)

    def say(self, text: str, style: str = "dim") -> None:
        """Print a line that stays."""
        soft_wrap = not self._console.is_terminal  # there it is broken between words
        self._console.print(Text(printable(text), style), soft_wrap=soft_wrap)

    def progress(self, progress: Progress) -> None:
        """The run has moved on."""
        if self._progress is None:
            self._told = progress.done
        elif progress.done > self._progress.done and progress.residual_mm is not None:
            self._residuals_mm.append(progress.residual_mm)
        self._progress = progress
        if self._verbose:
            self.say(f"{progress.done}/{progress.total} {news(progress)}")
        else:
            self._say_if_due()

    def event(self, text: str) -> None:
        """Something happened that the operator should read."""
        self._answer = ""
        if self._live is not None and self._live.is_started:
            self._events.append(text)
        else:
            self.say(f"! {text}", "yellow")

    def line(self) -> str:
        """Everything in one line."""
        progress = self._progress
        if progress is None:
            return f"{self._what}: connecting"
        advice = [progress.beam_advice] if progress.beam_advice else []
        told = [counted(progress), news(progress), *advice, *_goal(progress), *_known(progress)]
        return f"{self._what}: {' · '.join(told)}"

    def _say_events(self) -> None:
        for text in self._events:
            self.say(f"! {text}", "yellow")
        self._events.clear()

    def _say_if_due(self) -> None:
        """Where there is no screen, print a line if one is due: by time, or every few shots."""
        if self._live is not None:
            return
        with self._turn:
            done = 0 if self._progress is None else self._progress.done
            late = self._now_s() - self._told_s >= QUIET_RUN_S
            if late or abs(done - self._told) >= QUIET_SHOTS:
                self._told_s, self._told = self._now_s(), done
                self.say(self.line())

    def _beat(self) -> None:
        """Draw the screen anew; without one say that it is still there, also if nothing is new."""
        while not self._over.wait(self._pause_s()):
            self._say_if_due()
            with self._turn:
                self._redraw()

    def _redraw(self) -> None:
        """Draw the screen where it is another than before: a slow line carries no more."""
        if self._live is None or not self._live.is_started:
            return
        minute = self._clock().minute
        shown = (self._progress, len(self._events), self._console.size, minute, self._answer)
        if shown != self._shown:
            self._shown = shown
            self._live.refresh()

    def _pause_s(self) -> float:
        if self._live is not None:
            return REDRAWN_S
        return max(self._told_s + QUIET_RUN_S - self._now_s(), SHORTEST_S)


def state_and_rate(done: int, total: int, before: int, seconds: float) -> str:
    """State of a work after so many seconds, `before` of it done when it began: `4/9 · 2/s · …`."""
    told = f"{done}/{total}"
    if done == before or seconds <= 0.0:
        return told  # there is no rate yet
    rate_per_s = (done - before) / seconds
    left_s = (total - done) / rate_per_s
    return f"{told} · {_rate(rate_per_s)} · {interval((left_s, left_s))} left"


def interval(seconds: tuple[float, float]) -> str:
    """A time as an interval: `3–4 min`, `20–35 s`; one number where both ends round to it."""
    low, high = seconds
    unit, unit_s = ("min", MINUTE_S) if high >= 2 * MINUTE_S else ("s", 1.0)
    ends = dict.fromkeys(f"{end / unit_s:.0f}" for end in (low, high))
    return f"{'–'.join(ends)} {unit}"


def counted(progress: Progress) -> str:
    """Shots done and time left: `97/163 · 3–5 min left`."""
    left = [] if progress.eta_s is None else [f"{interval(progress.eta_s)} left"]
    return " · ".join([f"{progress.done}/{progress.total}", *left])


def news(progress: Progress) -> str:
    """State, last residual, drift, beam."""
    lost_s = progress.beam_lost_s
    lasted = f" for {interval((lost_s, lost_s))}" if lost_s else ""
    beam = "beam ok" if progress.beam_locked else f"BEAM LOST{lasted}"
    return " · ".join([_state(progress), *_figures(progress), beam])


def summary(progress: Progress) -> str:
    """Shots done and last figures of a run that is over."""
    shots = f"{progress.done} of {progress.total} shots"
    return " · ".join([shots, progress.state.value, *_figures(progress)])


def _figures(progress: Progress) -> list[str]:
    figures = (("residual", progress.residual_mm), ("drift", progress.drift_mm))
    return [f"{name} {value:.3f} mm" for name, value in figures if value is not None]


def _known(progress: Progress) -> list[str]:
    return [] if progress.known is None else [certainty(progress.known)]


def _goal(progress: Progress) -> list[str]:
    if progress.goal_mm is None:
        return []
    now = "not yet known" if progress.known is None else f"{progress.known.position_std_mm:.3g}"
    return [f"goal {progress.goal_mm:g} mm: {now}"]


def _state(progress: Progress) -> str:
    if progress.shot is None or progress.state in (EngineState.FINISHED, EngineState.STOPPED):
        return progress.state.value
    return f"{progress.state.value} {progress.purpose} {progress.shot}"


def _rate(per_second: float) -> str:
    """`95/s`, or `12/min` for what takes longer than a second."""
    return f"{per_second:.0f}/s" if per_second >= 1.0 else f"{MINUTE_S * per_second:.0f}/min"
