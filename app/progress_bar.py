"""A run on the terminal: shots k/N, time left, residual, beam, drift."""

from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from campaigns.progress import EngineState
from campaigns.progress import Progress as RunProgress

QUIET_EVERY = 20
"""Without a terminal a line is printed for every so many shots."""
MINUTE_S = 60.0


class RunDisplay:
    """A live bar on a terminal; now and then a line where there is none. A `Watcher`."""

    def __init__(self, console: Console, title: str) -> None:
        self._console = console
        self._live = console.is_terminal
        self._bar = Progress(
            TextColumn("[bold]{task.description}"),
            BarColumn(bar_width=24),
            TextColumn("{task.completed:.0f}/{task.total:.0f}"),
            TextColumn("{task.fields[news]}"),
            console=console,
            transient=False,
            disable=not self._live,
        )
        self._task = self._bar.add_task(title, total=None, news="")
        self._title = title
        self._told = -1

    def __enter__(self) -> "RunDisplay":
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bar.stop()

    def progress(self, progress: RunProgress) -> None:
        """The run has moved on."""
        news = news_line(progress)
        self._bar.update(self._task, completed=progress.done, total=progress.total, news=news)
        due = progress.done % QUIET_EVERY == 0 or progress.done == progress.total
        if not self._live and due and progress.done != self._told:
            self._told = progress.done
            self._console.print(f"{self._title} {progress.done}/{progress.total} {news}")

    def event(self, text: str) -> None:
        """Something happened that the operator should read."""
        self._console.print(f"! {text}", style="yellow", markup=False, soft_wrap=True)


def news_line(progress: RunProgress) -> str:
    """Everything beside the bar in one line."""
    parts = [_state(progress)]
    if progress.eta_s is not None:
        parts.append(f"left {interval(progress.eta_s)}")
    if progress.residual_mm is not None:
        parts.append(f"residual {progress.residual_mm:.3f} mm")
    if progress.drift_mm is not None:
        parts.append(f"drift {progress.drift_mm:.3f} mm")
    parts.append("beam ok" if progress.beam_locked else "BEAM LOST")
    return " · ".join(parts)


def _state(progress: RunProgress) -> str:
    if progress.shot is None or progress.state in (EngineState.FINISHED, EngineState.STOPPED):
        return progress.state.value
    return f"{progress.state.value} {progress.purpose} {progress.shot}"


def interval(seconds: tuple[float, float]) -> str:
    """A time as an interval: `3–4 min`, `20–35 s`."""
    low, high = seconds
    if high >= 2 * MINUTE_S:
        return f"{low / MINUTE_S:.0f}–{high / MINUTE_S:.0f} min"
    return f"{low:.0f}–{high:.0f} s"
