"""Work that is counted: k of N, how fast, and how long it will still take."""

from collections.abc import Callable
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from app.live_picture import MINUTE_S, QUIET_S, LivePicture, bar_row, interval


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
