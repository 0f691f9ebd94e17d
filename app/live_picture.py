"""What goes on, told the way the screen can take it: a live picture, or a line now and then."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from types import TracebackType
from typing import Self

from rich.console import Console, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

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
