"""How far the seeds are: a bar on a terminal, now and then a line where there is none."""

from collections.abc import Callable

from rich.console import Console

from app.papers.corbel2006.runner import Failure, Outcome
from app.progress import CountedWork


class SeedProgress(CountedWork):
    """Counts outcomes, and among them failures, while the block runs."""

    def __init__(
        self, console: Console, total: int, *, done: int, now_s: Callable[[], float]
    ) -> None:
        super().__init__(console, "seeds", total, done=done, now_s=now_s)
        self._failed = 0

    def count(self, outcome: Outcome) -> None:
        """One more has come to its end."""
        self._failed += isinstance(outcome, Failure)
        self.news = f"{self._failed} failed" if self._failed else ""
        self.advance()

    def line(self) -> str:
        """How many, and how many of them failed; seeds that differ in length have no rate."""
        pace = self.pace()
        return " · ".join(filter(None, [f"seeds: {pace.done} of {pace.total}", self.news]))
