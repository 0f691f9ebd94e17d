"""What goes on, told the way the screen can take it: a live picture, or a line now and then."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from campaigns.measuring.run_state import EngineState, ParameterPrecision, Progress

QUIET_S = 10.0
"""Without a terminal a line is printed every so many seconds."""
BAR_WIDTH = 30
MINUTE_S = 60.0


class LivePicture(ABC):
    """A picture that is kept up to date on a terminal while the block runs, and then goes away."""

    def __init__(
        self, console: Console, *, now_s: Callable[[], float], quiet_s: float = QUIET_S
    ) -> None:
        self._console = console
        self._now_s = now_s
        self._quiet_s = quiet_s
        self._began_s = self._told_s = now_s()
        self._live = Live(self, console=console, transient=True)

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._live.stop()

    def __rich__(self) -> RenderableType:
        return self._picture()

    @property
    def seconds(self) -> float:
        """Time since it was made."""
        return self._now_s() - self._began_s

    def say(self, text: str, style: str = "dim") -> None:
        """Print a line that stays, above the picture."""
        self._console.print(Text(text, style), soft_wrap=True)  # the style is not the picture's

    def say_if_due(self, line: Callable[[], str]) -> None:
        """Where there is no picture, print a line if the last one was long enough ago."""
        if self._console.is_terminal:
            return
        now_s = self._now_s()
        if now_s - self._told_s >= self._quiet_s:
            self._told_s = now_s
            self.say(line())

    @abstractmethod
    def _picture(self) -> RenderableType:
        """What is shown now; asked for several times a second, by a thread of its own."""


def bar_row(title: str, done: int, total: int, text: str) -> Table:
    """A bar between its title and how far it is, in one row that is never wrapped."""
    row = Table.grid(padding=(0, 1))
    bar = ProgressBar(total=max(total, 1), completed=done, width=BAR_WIDTH)
    row.add_row(Text(title, style="bold"), bar, Text(text, no_wrap=True))
    return row


def interval(seconds: tuple[float, float]) -> str:
    """A time as an interval: `3–4 min`, `20–35 s`; one number where both ends round to it."""
    low, high = seconds
    unit, unit_s = ("min", MINUTE_S) if high >= 2 * MINUTE_S else ("s", 1.0)
    ends = dict.fromkeys(f"{end / unit_s:.0f}" for end in (low, high))
    return f"{'–'.join(ends)} {unit}"


class RunDisplay(LivePicture):
    """A live bar on a terminal; now and then a line where there is none. A `RunObserver`.

    `verbose` tells every state of every shot.
    """

    def __init__(
        self, console: Console, title: str, *, now_s: Callable[[], float], verbose: bool
    ) -> None:
        super().__init__(console, now_s=now_s)
        self._title = title
        self._verbose = verbose
        self._progress: Progress | None = None

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        super().__exit__(kind, error, trace)
        if self._progress is None:
            return
        for line in (summary(self._progress), *_known(self._progress)):
            self.say(f"{self._title}: {line}")

    def progress(self, progress: Progress) -> None:
        """The run has moved on."""
        self._progress = progress
        if self._verbose:
            self.say(f"{progress.done}/{progress.total} {news(progress)}")
        else:
            self.say_if_due(lambda: f"{self._title}: {_everything(progress)}")

    def event(self, text: str) -> None:
        """Something happened that the operator should read."""
        self.say(f"! {text}", "yellow")

    def _picture(self) -> Group | Text:
        """The bar, and lines below it that are cut rather than wrapped."""
        progress = self._progress
        if progress is None:
            return Text(f"{self._title}: connecting", style="dim")
        row = bar_row(self._title, progress.done, progress.total, counted(progress))
        style = "dim" if progress.beam_locked else "bold red"
        below = [(news(progress), style), *((line, "dim") for line in _knowledge(progress))]
        lines = [Text(text, style, no_wrap=True, overflow="ellipsis") for text, style in below]
        return Group(row, *lines)


def counted(progress: Progress) -> str:
    """How far it is: `97/163 · 3–5 min left`."""
    left = [] if progress.eta_s is None else [f"{interval(progress.eta_s)} left"]
    return " · ".join([f"{progress.done}/{progress.total}", *left])


def news(progress: Progress) -> str:
    """What goes on: state, last residual, drift, beam."""
    return " · ".join([_state(progress), *_figures(progress), _beam(progress)])


def summary(progress: Progress) -> str:
    """What was reached, when it is over."""
    shots = f"{progress.done} of {progress.total} shots"
    return " · ".join([shots, progress.state.value, *_figures(progress)])


def certainty(known: ParameterPrecision) -> str:
    """How surely the parameters are known: `weakest arm2.z_mm ±0.021 mm · position ±0.006 mm`."""
    std = f"{known.weakest_std:.3f} mm" if known.unit == "mm" else f"{known.weakest_std:.4f}°"
    return f"weakest {known.weakest} ±{std} · position ±{known.position_std_mm:.3f} mm"


def _everything(progress: Progress) -> str:
    return " · ".join([counted(progress), news(progress), *_knowledge(progress)])


def _figures(progress: Progress) -> list[str]:
    figures = (("residual", progress.residual_mm), ("drift", progress.drift_mm))
    return [f"{name} {value:.3f} mm" for name, value in figures if value is not None]


def _knowledge(progress: Progress) -> list[str]:
    """A line of what shall be known and what is; none where there is nothing to say of it."""
    told = [*_goal(progress), *_known(progress)]
    return [" · ".join(told)] if told else []


def _known(progress: Progress) -> list[str]:
    return [] if progress.known is None else [certainty(progress.known)]


def _goal(progress: Progress) -> list[str]:
    if progress.goal_mm is None:
        return []
    now = "not yet known" if progress.known is None else f"{progress.known.length_std_mm:.3g}"
    return [f"goal σ={progress.goal_mm:g}: {now}"]


def _beam(progress: Progress) -> str:
    return "beam ok" if progress.beam_locked else "BEAM LOST"


def _state(progress: Progress) -> str:
    if progress.shot is None or progress.state in (EngineState.FINISHED, EngineState.STOPPED):
        return progress.state.value
    return f"{progress.state.value} {progress.purpose} {progress.shot}"


@dataclass(frozen=True, slots=True)
class Pace:
    """How far a work is after so many seconds; `before` of it was done when it began."""

    done: int
    total: int
    before: int
    seconds: float

    @property
    def rate_per_s(self) -> float:
        """What was done in this time; 0 while nothing was."""
        return (self.done - self.before) / self.seconds if self.seconds > 0.0 else 0.0

    @property
    def left_s(self) -> float | None:
        """Time that the rest takes at this rate; None while there is no rate."""
        return (self.total - self.done) / self.rate_per_s if self.rate_per_s else None

    def __str__(self) -> str:
        told = [f"{self.done}/{self.total}"]
        if self.left_s is not None:
            told += [_rate(self.rate_per_s), f"{interval((self.left_s, self.left_s))} left"]
        return " · ".join(told)


class CountedWork(LivePicture):
    """A bar on a terminal while the block runs, now and then a line where there is none."""

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
        super().__init__(console, now_s=now_s, quiet_s=quiet_s)
        self._what = what
        self._total = total
        self._before = self._done = done
        self.news = ""
        """What else there is to say."""

    def advance(self, more: int = 1) -> None:
        """So many more are done."""
        self._done += more
        self.say_if_due(self.line)

    def pace(self) -> Pace:
        """How far it is now."""
        return Pace(self._done, self._total, self._before, self.seconds)

    def line(self) -> str:
        """What is told where there is no terminal."""
        return f"{self._what}: {self._told()}"

    def _picture(self) -> Table:
        return bar_row(self._what, self._done, self._total, self._told())

    def _told(self) -> str:
        return " · ".join(filter(None, [str(self.pace()), self.news]))


def _rate(per_second: float) -> str:
    """`95/s`, or `12/min` for what takes longer than a second."""
    return f"{per_second:.0f}/s" if per_second >= 1.0 else f"{MINUTE_S * per_second:.0f}/min"
