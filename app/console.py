"""The one owner of the terminal: answers on stdout, talk on stderr."""

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

if TYPE_CHECKING:
    from app.progress_bar import RunDisplay

GOOD, BAD, OPEN = "bold green", "bold red", "bold yellow"


class Terminal:
    """With `as_json` everything for people goes to stderr, and one document to stdout."""

    def __init__(self, *, as_json: bool) -> None:
        self._as_json = as_json
        self.talk = Console(stderr=True, highlight=False)
        self._answers = self.talk if as_json else Console(highlight=False)

    def say(self, text: str, style: str = "") -> None:
        """A line of the answer."""
        self._answers.print(text, style=style, markup=False, soft_wrap=True)

    def note(self, text: str, style: str = "dim") -> None:
        """A line of talk."""
        self.talk.print(text, style=style, markup=False, soft_wrap=True)

    def table(self, title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """A table; all columns but the first are numbers or short words, set to the right."""
        table = Table(title=title, title_justify="left", header_style="bold", title_style="bold")
        for place, column in enumerate(columns):
            table.add_column(column, justify="right" if place else "left", no_wrap=place > 0)
        for row in rows:
            table.add_row(*row)
        self._answers.print(table)

    def document(self, document: Mapping[str, object]) -> None:
        """The answer for programs; only with `as_json`."""
        if self._as_json:
            sys.stdout.write(json.dumps(document, allow_nan=False) + "\n")
            sys.stdout.flush()

    def confirm(self, question: str) -> bool:
        """Ask the operator; without a terminal the answer is no."""
        if not sys.stdin.isatty():
            return False
        self.talk.print(f"{question} [y/N] ", style="bold", end="", markup=False)
        return sys.stdin.readline().strip().lower() in {"y", "yes"}

    @contextmanager
    def watching(self, title: str) -> Iterator["RunDisplay"]:
        """Show a run while it runs."""
        from app.progress_bar import RunDisplay

        display = RunDisplay(self.talk, title)
        with display:
            yield display
