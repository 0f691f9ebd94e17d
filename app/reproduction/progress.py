"""How far the seeds are: a bar on a terminal, now and then a line where there is none."""

from collections.abc import Callable
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from app.reproduction.runner import Failure, Outcome

QUIET_S = 10.0
"""Without a terminal a line is printed every so many seconds."""


class SeedProgress:
    """Counts outcomes while the block runs."""

    def __init__(
        self, console: Console, total: int, *, done: int, now_s: Callable[[], float]
    ) -> None:
        self._console = console
        self._now_s = now_s
        self._told_s = now_s()
        self._total = total
        self._done = done
        self._failed = 0
        self._bar = Progress(
            TextColumn("[bold]seeds"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(compact=True, elapsed_when_finished=True),
            TextColumn("{task.description}"),
            console=console,
            transient=True,
        )
        self._task = self._bar.add_task("", total=total, completed=done)

    def __enter__(self) -> "SeedProgress":
        if self._console.is_terminal:
            self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._console.is_terminal:
            self._bar.stop()

    def count(self, outcome: Outcome) -> None:
        """One more has come to its end."""
        self._done += 1
        self._failed += isinstance(outcome, Failure)
        news = f"{self._failed} failed" if self._failed else ""
        self._bar.update(self._task, completed=self._done, description=news)
        if not self._console.is_terminal and self._now_s() - self._told_s >= QUIET_S:
            self._told_s = self._now_s()
            line = f"seeds: {self._done} of {self._total}" + (f" · {news}" if news else "")
            self._console.print(line, style="dim", markup=False, soft_wrap=True)
