"""The one owner of the terminal: answers on stdout, talk on stderr, all of it cleaned."""

# A command prints three kinds of text, and each has one way out:
#
# - answers (`say`, `table`, `listing`): what the command was asked for. They go to stdout.
# - talk (`note`, `detail`, `alarm`, questions, progress): all else. It goes to stderr.
# - the document (`conclude`) with --json: one line of JSON, then alone on stdout; answers go to
#   stderr as well. So `pkmcal … --json | program` reads a document, and people still read all.
#
# All texts pass `printable` on their way: serial numbers, file names and controllers' messages may
# hold escape sequences that would move the cursor or hide a line. Lines are printed as rich's
# `Text`, in which brackets are brackets and no markup.
#
# Questions are asked on stderr, and only where stdin is a terminal; see app/keyboard.py.

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

import typer
from pydantic_core import to_jsonable_python
from rich import box
from rich.console import Console
from rich.progress import Progress as Bars
from rich.progress import TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from app.exits import Exit, NotConfirmed
from app.keyboard import KEYBOARD
from app.progress import say
from app.streams import FULL_HEIGHT, print_document
from campaigns.files.table import Column, texts
from drivers.errors import LinkDown
from drivers.ports import Prompt
from drivers.texts import printable

if TYPE_CHECKING:  # help and messages need neither: all of the work would be loaded for them
    from app.run_screen import RunLines
    from campaigns.next_step import NextStep

T = TypeVar("T")

GOOD, BAD, OPEN = "bold green", "bold red", "bold yellow"
DECISIONS: Mapping[str, str] = {
    "pass": GOOD,
    "fail": BAD,
    "not decided": OPEN,
    "no limits specified": OPEN,
}
"""How each decision looks."""
TALK, WARNING = "dim", "yellow"
COLUMN_GAP = 3
"""Characters between two columns of a table."""


def is_yes(typed: str) -> bool:
    """Return whether an answer means yes; nothing typed means no."""
    return typed.strip().lower() in {"y", "yes"}


class Terminal:
    """Terminal of a command; with `as_json` stdout is for the document, stderr for people."""

    def __init__(self, *, as_json: bool, verbose: bool = False, command: str = "") -> None:
        self._as_json = as_json
        self._command = command
        self.is_verbose = verbose
        """Whether the user asked for more lines."""

    # made when first used: a console takes over the streams and variables that it finds then
    @cached_property
    def _talk(self) -> Console:
        return Console(stderr=True, highlight=False, emoji=False)

    @cached_property
    def _answers(self) -> Console:
        return self._talk if self._as_json else Console(highlight=False, emoji=False)

    @property
    def is_small(self) -> bool:
        """Whether the screen has so few lines that the verdict alone fits, without tables."""
        return self._answers.is_terminal and self._answers.height < FULL_HEIGHT

    def say(self, text: str, style: str = "") -> None:
        """Print a line of the answer, on stdout; on stderr if the answer is a JSON document."""
        say(self._answers, text, style)

    def note(self, text: str, style: str = TALK) -> None:
        """Print a line of talk."""
        say(self._talk, text, style)

    def alarm(self, text: str) -> None:
        """Print a line that the operator has to read immediately."""
        self.note(text, BAD)

    def detail(self, text: str) -> None:
        """Print a line of talk if the user gave --verbose."""
        if self.is_verbose:
            self.note(text)

    def table(self, title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Print a table; all columns but the first are numbers or short words, set to the right.

        A last column without a name holds words: it is the one whose cells may be wrapped. A table
        that is too wide for the screen is printed row by row: no name is cut.
        """
        # A table needs the width of the longest cell of each column; of the column of words (the
        # last one if it has no name, else the first) that of the longest word.
        words = len(columns) - 1 if not columns[-1] else 0
        contents = [*zip(columns, *rows, strict=True)]
        widths = [max(map(len, column)) for column in contents]
        widths[words] = max(len(word) for cell in contents[words] for word in cell.split() or [""])
        if sum(widths) + COLUMN_GAP * (len(columns) - 1) > self._answers.width:
            self._print_by_rows(title, columns, rows)
            return
        table = Table(
            title=printable(title),
            title_justify="left",
            title_style="bold",
            box=box.SIMPLE_HEAD,
            show_edge=False,
            pad_edge=False,
        )
        for place, column in enumerate(columns):
            numbers = place not in {0, words}
            kept_whole = place != words
            table.add_column(column, justify="right" if numbers else "left", no_wrap=kept_whole)
        for row in rows:
            table.add_row(*(printable(cell) for cell in row))
        self._answers.print("", table, "", sep="\n")

    def _print_by_rows(
        self, title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]
    ) -> None:
        """Print a line for each row, with its columns' names."""
        self.say(title, "bold")
        for first, *cells in rows:
            pairs = zip(columns[1:], cells, strict=True)
            named = [f"{head} {cell.strip()}".strip() for head, cell in pairs if cell.strip()]
            self.say(f"{first}: {'; '.join(named)}")

    def rows(self, title: str, columns: Sequence[Column[T]], rows: Iterable[T]) -> None:
        """Print the table of these rows; nothing without any."""
        if cells := texts(columns, rows):
            self.table(title, [column.head for column in columns], cells)

    def listing(self, title: str, lines: Mapping[str, str]) -> None:
        """Print names with texts that may be long."""
        self.say(title, "bold")
        width = max(map(len, lines), default=0)
        for name, text in lines.items():
            self.say(f"  {name:<{width}}  {text}")

    def conclude(
        self, answer: object, step: "NextStep | None" = None, *, is_good: bool = True
    ) -> None:
        """End a command: with `as_json` print its answer and the next command as a document.

        Raise Typer's `Exit` with code 1 if the result is not good.
        """
        if self._as_json:
            document = {"schema": f"pkmcal/{self._command}/1", **to_jsonable_python(answer)}
            document["next"] = step.text if step else None
            document["before_next"] = (step and step.first) or None
            document["next_reason"] = (step and step.why) or None
            print_document(document)
        if not is_good:
            raise typer.Exit(Exit.NOT_GOOD)

    def asks(self, question: str) -> bool:
        """Ask, and return whether the operator says yes; False without a terminal."""
        try:
            return self.has_somebody and is_yes(self._ask_for_line(f"{question} [y/N] "))
        except LinkDown:  # the terminal was closed
            return False
        except KeyboardInterrupt:
            self._talk.print()  # the next message begins on a line of its own
            raise

    @property
    def has_somebody(self) -> bool:
        """Whether there is a terminal at which somebody can answer."""
        return KEYBOARD.has_somebody

    def prompt(
        self, display: "RunLines | None" = None, stop_requested: Callable[[], bool] = lambda: False
    ) -> Prompt | None:
        """Return a function that asks for a line while a run is shown; None without a terminal.

        The function raises `Cancelled` once a stop is requested, and `LinkDown` if the terminal is
        closed.
        """
        if not self.has_somebody:
            return None

        def ask(question: str) -> str:
            with nullcontext() if display is None else display.paused():
                return self._ask_for_line(question, stop_requested)

        return ask

    def _ask_for_line(
        self, question: str, stop_requested: Callable[[], bool] = lambda: False
    ) -> str:
        """Ask, and return the line that the operator types after the question."""
        *lines, last = question.split("\n")

        def show() -> None:
            for line in lines:
                self.note(line, OPEN)
            words = Text(printable(last), "bold")
            self._talk.print(words, end="", soft_wrap=not self._talk.is_terminal)

        return KEYBOARD.line(show, stop_requested)

    def require_somebody(self) -> None:
        """Raise `NotConfirmed` where no operator can be asked."""
        self.require_yes("", yes=self.has_somebody)

    def require_yes(self, question: str, *, yes: bool) -> None:
        """Raise `NotConfirmed` without the operator's yes, given before or now."""
        if not yes and not self.asks(question):
            raise NotConfirmed(
                "not confirmed, nothing was done",
                remedy="answer y on a terminal, or give --yes when the cell is clear",
            )

    @contextmanager
    def telling(self, text: str) -> Iterator[Callable[[str], None]]:
        """Show the block's work and its duration on a terminal; yield what changes the words."""
        columns = (TextColumn("{task.description}", markup=False), TimeElapsedColumn())
        is_shown = self._talk.is_interactive
        with Bars(*columns, console=self._talk, transient=True, disable=not is_shown) as bars:
            task = bars.add_task(printable(text), total=None)
            yield lambda news: bars.update(task, description=printable(news))

    def watching(
        self, title: str, *, plain: bool = False, shot_by_shot: bool = False
    ) -> "RunLines":
        """Return the display of a run; with `plain` it prints lines, one a shot if wanted."""
        from app.run_screen import RunLines, RunScreen

        if self._talk.is_interactive and not plain and not self.is_verbose:
            return RunScreen(self._talk, title)
        return RunLines(self._talk, title, verbose=self.is_verbose, shot_by_shot=shot_by_shot)
