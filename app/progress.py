"""Progress of a work, told the way the screen can take it: a bar, or a line now and then."""

import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Self

from rich.console import Console, RenderableType
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bars
from rich.text import Text

from campaigns.measuring.run_state import EngineState, ParameterUncertainty, Progress, RunObserver
from drivers.errors import PRESS_THE_EMERGENCY_STOP, RobotStateUnknown
from drivers.texts import printable

QUIET_S = 10.0
"""Without a terminal a line is printed every so many seconds."""
QUIET_RUN_S = 30.0
QUIET_SHOTS = 10
"""Of a run the same: after so many seconds, also while one thing is waited for, or shots."""
BAR_WIDTH = 30
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
        self._before = self._done = self._told = done
        self._began_s = self._told_s = now_s()
        self._bars = _Bars(console, self._below)
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

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Time without the bar, for questions and answers."""
        self._bars.stop()
        try:
            yield
        finally:
            self._bars.start()

    def advance(self, more: int = 1) -> None:
        """So many more are done."""
        self._done += more
        self._bars.update(self._bar, completed=self._done)
        self._say_if_due()

    def line(self) -> str:
        """The line for where there is no terminal."""
        return f"{self._what}: {self}"

    def say(self, text: str, style: str = "dim") -> None:
        """Print a line that stays, above the bar."""
        line = Text(printable(text), style)  # the style is not the bar's
        self._console.print(line, soft_wrap=True)

    def _say_if_due(self) -> None:
        """Where there is no bar, print a line if one is due."""
        if self._bars.disable and self._is_due():
            self._told_s, self._told = self._now_s(), self._done
            self.say(self.line())

    def _is_due(self) -> bool:
        """Whether the last line was long enough ago."""
        return self._now_s() - self._told_s >= self._quiet_s

    def _below(self) -> Iterable[Text]:
        """Lines below the bar."""
        return ()


class _Bars(Bars):
    """A title, its bar and its text in one row that is never wrapped, and lines below it."""

    def __init__(self, console: Console, below: Callable[[], Iterable[Text]]) -> None:
        self._below = below
        super().__init__(
            TextColumn("{task.description}", style="bold", markup=False),
            BarColumn(BAR_WIDTH),
            TextColumn("{task.fields[text]}", markup=False),
            console=console,
            transient=True,
            refresh_per_second=4,  # each drawing takes its time from the work
            disable=not console.is_interactive,
        )

    def get_renderables(self) -> Iterable[RenderableType]:
        """The parts of the picture, from above."""
        yield from super().get_renderables()
        yield from self._below()


class RunDisplay(CountedWork, RunObserver):
    """The shots of a run, with its news below the bar.

    `verbose` tells every state of every shot.
    """

    def __init__(
        self, console: Console, title: str, *, now_s: Callable[[], float], verbose: bool
    ) -> None:
        self._progress: Progress | None = None  # first: the bars look at it when they are made
        super().__init__(console, title, 0, now_s=now_s, quiet_s=QUIET_RUN_S)
        self._verbose = verbose
        self._turn = threading.Lock()
        self._over = threading.Event()
        self._heart = threading.Thread(target=self._beat, name="progress", daemon=True)
        self._bars.update(self._bar, visible=False)

    def __enter__(self) -> Self:
        super().__enter__()
        if self._bars.disable:
            self._heart.start()
        return self

    def __exit__(self, *error: object) -> None:
        super().__exit__(*error)
        self._over.set()
        if self._heart.ident is not None:
            self._heart.join()
        if isinstance(error[1], RobotStateUnknown):
            self.say(PRESS_THE_EMERGENCY_STOP, "bold red")
        if self._progress is not None:
            for line in (summary(self._progress), *_known(self._progress)):
                self.say(f"{self._what}: {line}")

    def __str__(self) -> str:
        return "connecting" if self._progress is None else counted(self._progress)

    def progress(self, progress: Progress) -> None:
        """The run has moved on."""
        if self._progress is None:
            self._told = progress.done
        self._progress, self._done = progress, progress.done
        total = max(progress.total, 1)
        self._bars.update(self._bar, completed=progress.done, total=total, visible=True)
        if self._verbose:
            self.say(f"{progress.done}/{progress.total} {news(progress)}")
        else:
            self._say_if_due()

    def _say_if_due(self) -> None:
        with self._turn:
            super()._say_if_due()

    def _is_due(self) -> bool:
        """The same, and after every few shots."""
        return super()._is_due() or abs(self._done - self._told) >= QUIET_SHOTS

    def _beat(self) -> None:
        """Say that it is still there, also while nothing is new."""
        while not self._over.wait(max(self._told_s + self._quiet_s - self._now_s(), SHORTEST_S)):
            self._say_if_due()

    def event(self, text: str) -> None:
        """Something happened that the operator should read."""
        self.say(f"! {text}", "yellow")

    def line(self) -> str:
        """Everything in one line."""
        return " · ".join([super().line(), *(line.plain for line in self._below())])

    def _below(self) -> Iterable[Text]:
        """News, and what is known: lines that are cut rather than wrapped."""
        if self._progress is None:
            return [Text(f"{self._what}: {self}", "dim")]
        style = "dim" if self._progress.beam_locked else "bold red"
        told = [(news(self._progress), style)]
        if self._progress.beam_advice:
            told += [(self._progress.beam_advice, style)]
        if knowledge := [*_goal(self._progress), *_known(self._progress)]:
            told += [(" · ".join(knowledge), "dim")]
        return [
            Text(printable(text), style, no_wrap=True, overflow="ellipsis") for text, style in told
        ]


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


def certainty(known: ParameterUncertainty) -> str:
    """Uncertainty of the parameters: `weakest arm2.z_mm ±0.021 mm · position ±0.006 mm`."""
    std = f"{known.weakest_std:.3f} mm" if known.unit == "mm" else f"{known.weakest_std:.4f}°"
    return f"weakest {known.weakest} ±{std} · position ±{known.position_std_mm:.3f} mm"


def _figures(progress: Progress) -> list[str]:
    figures = (("residual", progress.residual_mm), ("drift", progress.drift_mm))
    return [f"{name} {value:.3f} mm" for name, value in figures if value is not None]


def _known(progress: Progress) -> list[str]:
    return [] if progress.known is None else [certainty(progress.known)]


def _goal(progress: Progress) -> list[str]:
    if progress.goal_mm is None:
        return []
    now = "not yet known" if progress.known is None else f"{progress.known.length_std_mm:.3g}"
    return [f"goal σ={progress.goal_mm:g}: {now}"]


def _state(progress: Progress) -> str:
    if progress.shot is None or progress.state in (EngineState.FINISHED, EngineState.STOPPED):
        return progress.state.value
    return f"{progress.state.value} {progress.purpose} {progress.shot}"


def _rate(per_second: float) -> str:
    """`95/s`, or `12/min` for what takes longer than a second."""
    return f"{per_second:.0f}/s" if per_second >= 1.0 else f"{MINUTE_S * per_second:.0f}/min"
