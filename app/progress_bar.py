"""A run on the terminal: shots k/N, time left, residual, beam, drift."""

from collections.abc import Callable
from types import TracebackType

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from campaigns.progress import EngineState, Progress

QUIET_S = 10.0
"""Without a terminal a line is printed every so many seconds."""
BAR_WIDTH = 30
MINUTE_S = 60.0


class RunDisplay:
    """A live bar on a terminal; now and then a line where there is none. A `Watcher`.

    `verbose` tells every state of every shot.
    """

    def __init__(
        self, console: Console, title: str, *, now_s: Callable[[], float], verbose: bool
    ) -> None:
        self._console = console
        self._title = title
        self._now_s = now_s
        self._verbose = verbose
        self._progress: Progress | None = None
        self._told_s = now_s()
        self._live = Live(console=console, get_renderable=self._picture, transient=True)

    def __enter__(self) -> "RunDisplay":
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
        if self._progress is not None:
            self._print(f"{self._title}: {summary(self._progress)}")

    def progress(self, progress: Progress) -> None:
        """The run has moved on."""
        self._progress = progress
        if self._verbose:
            self._print(f"{progress.done}/{progress.total} {news(progress)}")
        elif not self._console.is_terminal and self._now_s() - self._told_s >= QUIET_S:
            self._told_s = self._now_s()
            self._print(f"{self._title}: {counted(progress)} · {news(progress)}")

    def event(self, text: str) -> None:
        """Something happened that the operator should read."""
        self._print(f"! {text}", "yellow")

    def _print(self, text: str, style: str = "dim") -> None:
        self._console.print(text, style=style, markup=False, soft_wrap=True)

    def _picture(self) -> Group | Text:
        """The bar, and a line below it that is cut rather than wrapped."""
        progress = self._progress
        if progress is None:
            return Text(f"{self._title}: connecting", style="dim")
        bar = ProgressBar(total=max(progress.total, 1), completed=progress.done, width=BAR_WIDTH)
        line = Table.grid(padding=(0, 1))
        line.add_row(Text(self._title, style="bold"), bar, Text(counted(progress), no_wrap=True))
        style = "dim" if progress.beam_locked else "bold red"
        return Group(line, Text(news(progress), style=style, no_wrap=True, overflow="ellipsis"))


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


def interval(seconds: tuple[float, float]) -> str:
    """A time as an interval: `3–4 min`, `20–35 s`; one number where both ends round to it."""
    low, high = seconds
    unit, unit_s = ("min", MINUTE_S) if high >= 2 * MINUTE_S else ("s", 1.0)
    ends = dict.fromkeys(f"{end / unit_s:.0f}" for end in (low, high))
    return f"{'–'.join(ends)} {unit}"


def _figures(progress: Progress) -> list[str]:
    figures = (("residual", progress.residual_mm), ("drift", progress.drift_mm))
    return [f"{name} {value:.3f} mm" for name, value in figures if value is not None]


def _beam(progress: Progress) -> str:
    return "beam ok" if progress.beam_locked else "BEAM LOST"


def _state(progress: Progress) -> str:
    if progress.shot is None or progress.state in (EngineState.FINISHED, EngineState.STOPPED):
        return progress.state.value
    return f"{progress.state.value} {progress.purpose} {progress.shot}"
