"""Progress of counted work: a bar on a terminal, a line every tenth of the work elsewhere."""

# Two readers need two forms. On a terminal a bar replaces itself several times a second; in a file
# or a pipe every update would be another line, so there a line is printed when a further tenth of
# the work is done: at most ten lines, however long the work. Lines that have to stay (`say`) go
# through the console of the bar, which prints them above it.
#
# Times are intervals (`3–4 min`), because the pace of the last shots says no more than that.

from typing import Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bars
from rich.text import Text

from drivers.texts import printable

TENTHS = 10
MINUTE_S = 60.0


class CountedWork:
    """Bar or lines while the block runs; `news` are words after the numbers."""

    def __init__(self, console: Console, what: str, total: int, *, done: int = 0) -> None:
        self._console, self._what, self._total, self._done = console, what, max(total, 1), done
        self._bars = Bars(
            TextColumn("{task.description}", style="bold", markup=False),
            BarColumn(30),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[news]}", markup=False),
            console=console,
            transient=True,
            refresh_per_second=4,
            disable=not console.is_interactive,
        )
        self._bar = self._bars.add_task(what, total=self._total, completed=done, news="")
        self.news = ""

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._bars.stop()

    def advance(self, more: int = 1) -> None:
        """Count further work as done; without a screen, print a line at each tenth of it."""
        before, self._done = self._done, self._done + more
        self._bars.update(self._bar, completed=self._done, news=self.news)
        if self._bars.disable and is_next_tenth(before, self._done, self._total):
            news = f" · {self.news}" if self.news else ""
            self.say(f"{self._what}: {self._done}/{self._total}{news}")

    def say(self, text: str, style: str = "dim") -> None:
        """Print a line that stays, above the bar."""
        say(self._console, text, style)


def is_next_tenth(before: int, done: int, total: int) -> bool:
    """Return whether another tenth of the work is done."""
    return TENTHS * done // max(total, 1) > TENTHS * before // max(total, 1)


def say(console: Console, text: str, style: str) -> None:
    """Print a line, wrapped between words on a terminal; a line in a file or pipe stays whole."""
    console.print(Text(printable(text), style), soft_wrap=not console.is_terminal)


def interval(seconds: tuple[float, float]) -> str:
    """Return a time as an interval: `3–4 min`, `20–35 s`; one number if both ends round to it."""
    low, high = seconds
    name, unit_s = ("min", MINUTE_S) if high >= 2 * MINUTE_S else ("s", 1.0)
    bounds = dict.fromkeys(f"{bound / unit_s:.0f}" for bound in (low, high))  # equal ones once
    return f"{'–'.join(bounds)} {name}"
