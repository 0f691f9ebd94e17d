"""The one owner of the terminal: answers on stdout, talk on stderr, all of it cleaned."""

import io
import json
import os
import select
import sys
import termios
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from functools import cached_property, partial
from threading import Event, Thread
from time import monotonic
from typing import TypeVar

import typer
from pydantic_core import to_jsonable_python
from rich import box
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from app.exits import NotConfirmed
from app.keys import LOOK_S, TYPED_BYTES, Keyboard, keys_heard, typed_line
from app.progress import RunDisplay
from campaigns.files.table import Column, texts
from drivers.ports import Prompt
from drivers.texts import printable

T = TypeVar("T")

GOOD, BAD, OPEN = "bold green", "bold red", "bold yellow"
DECISIONS: Mapping[str, str] = {"pass": GOOD, "fail": BAD, "not decided": OPEN}
"""How each decision looks."""
TALK, WARNING = "dim", "yellow"
LIKE_A_TERMINAL = {"FORCE_COLOR", "TTY_COMPATIBLE"}
"""Variables by which users want styles where there is no terminal."""
NO_NEXT: Mapping[str, None] = {"next": None, "before_next": None, "next_reason": None}
"""What a document says where no command follows."""
SILENT_S = 1.0
"""Work of so long needs no word."""
REDRAWN_S = 1.0
"""After so long its line is drawn again: each drawing takes its time from the work."""


def terminal_of(context: typer.Context, *, as_json: bool) -> "Terminal":
    """The terminal as the global options want it."""
    command = context.info_name or ""
    return Terminal(as_json=as_json, verbose=context.obj is True, command=command)


def forget_what_was_typed() -> None:
    """Drop what waits to be read from the terminal: it answers no question that comes later."""
    with suppress(termios.error, io.UnsupportedOperation):  # no terminal, or none any more
        termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)


def is_yes(typed: str) -> bool:
    """Whether an answer means yes; nothing typed means no."""
    return typed.strip().lower() in {"y", "yes"}


def _typed_piece() -> bytes | None:
    """Read what is typed into a terminal of which no keys are heard; None while nothing is."""
    ready, _, _ = select.select([sys.stdin], [], [], LOOK_S)
    return os.read(sys.stdin.fileno(), TYPED_BYTES) if ready else None


@contextmanager
def _lines() -> Iterator[Callable[[Callable[[], bool]], str]]:
    """Give the function that waits for a line, as `typed_line` does, where no keys are heard."""
    forget_what_was_typed()
    yield partial(typed_line, _typed_piece)


def _not_confirmed() -> NotConfirmed:
    return NotConfirmed(
        "not confirmed, nothing was done",
        remedy="answer y on a terminal, or give --yes when the cell is clear",
    )


class Terminal:
    """With `as_json` everything for people goes to stderr, and one document to stdout."""

    def __init__(self, *, as_json: bool, verbose: bool = False, command: str = "") -> None:
        self._as_json = as_json
        self._command = command
        self._verbose = verbose
        self._keyboard: Keyboard | None = None
        """Reader of the keys while they are heard: it answers the questions then."""

    @cached_property
    def _talk(self) -> Console:
        return Console(stderr=True, highlight=False, emoji=False)

    @cached_property
    def _answers(self) -> Console:
        return self._talk if self._as_json else Console(highlight=False, emoji=False)

    def say(self, text: str, style: str = "") -> None:
        """A line of the answer."""
        self._line(text, style, is_talk=self._as_json)

    def note(self, text: str, style: str = TALK) -> None:
        """A line of talk."""
        self._line(text, style, is_talk=True)

    def _line(self, text: str, style: str, *, is_talk: bool) -> None:
        """A line; on a terminal it is broken between words, elsewhere not at all."""
        stream = sys.stderr if is_talk else sys.stdout
        if stream is None:
            return
        if stream.isatty() or LIKE_A_TERMINAL & os.environ.keys():
            console = self._talk if is_talk else self._answers
            kept_whole = not console.is_terminal
            console.print(printable(text), style=style, markup=False, soft_wrap=kept_whole)
        else:
            stream.write(f"{printable(text)}\n")
            stream.flush()

    def alarm(self, text: str) -> None:
        """A line that the operator has to read at once."""
        self.note(text, BAD)

    def detail(self, text: str) -> None:
        """A line of talk for those who asked for more."""
        if self._verbose:
            self.note(text)

    def table(self, title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """A table; all columns but the first are numbers or short words, set to the right.

        A last column without a name holds words, which are broken into lines before anything else.
        """
        table = Table(
            title=printable(title),
            title_justify="left",
            title_style="bold",
            box=box.SIMPLE_HEAD,
            show_edge=False,
            pad_edge=False,
        )
        words = len(columns) - 1 if not columns[-1] else 0
        for place, column in enumerate(columns):
            numbers = place not in {0, words}
            kept_whole = place != words
            table.add_column(column, justify="right" if numbers else "left", no_wrap=kept_whole)
        for row in rows:
            table.add_row(*(printable(cell) for cell in row))
        self._answers.print("", table, "", sep="\n")

    def rows(self, title: str, columns: Sequence[Column[T]], rows: Iterable[T]) -> None:
        """The table of these rows."""
        self.table(title, [column.head for column in columns], texts(columns, rows))

    def listing(self, title: str, lines: Mapping[str, str]) -> None:
        """Names with texts that may be long."""
        self.say(title, "bold")
        width = max(map(len, lines), default=0)
        for name, text in lines.items():
            self.say(f"  {name:<{width}}  {text}")

    def document(self, document: Mapping[str, object]) -> None:
        """The answer for programs, values and paths in it as they are; only with `as_json`."""
        if self._as_json and sys.stdout is not None:
            beginning = {"schema": f"pkmcal/{self._command}/1", **NO_NEXT}
            plain = to_jsonable_python({**beginning, **document})
            sys.stdout.write(json.dumps(plain, allow_nan=False) + "\n")
            sys.stdout.flush()

    def asks(self, question: str) -> bool:
        """Whether the operator says yes, now; without a terminal nobody does."""
        if not self.has_somebody:
            return False
        forget_what_was_typed()
        asked = f"{printable(question)} [y/N] "
        self._talk.print(asked, style="bold", end="", markup=False, soft_wrap=True)
        try:
            return is_yes(sys.stdin.readline())
        except KeyboardInterrupt:
            self._talk.print()  # what is said next begins a line
            raise

    @property
    def has_somebody(self) -> bool:
        """Whether there is a terminal at which somebody can answer."""
        return sys.stdin is not None and sys.stdin.isatty()

    def prompt(
        self,
        display: "RunDisplay | None" = None,
        stop_requested: Callable[[], bool] = lambda: False,
    ) -> Prompt | None:
        """Way to ask the operator for a line while a run is shown; None: nobody is there."""
        if not self.has_somebody:
            return None

        def asked(question: str) -> str:
            with nullcontext() if display is None else display.paused():
                return self._answer(question, stop_requested)

        return asked

    def _answer(self, question: str, stop_requested: Callable[[], bool]) -> str:
        """The line that the operator types now; raises `Cancelled` once a stop is requested.

        What was typed before the question answers nothing. `LinkDown` when the terminal closes.
        """
        with _lines() if self._keyboard is None else self._keyboard.lines() as answer:
            for line in question.split("\n")[:-1]:
                self.note(line, OPEN)
            last = printable(question.rpartition("\n")[2])
            self._talk.print(last, style="bold", end="", markup=False, soft_wrap=True)
            return answer(stop_requested)

    @contextmanager
    def hearing(self, pressed: Callable[[str], None]) -> Iterator[None]:
        """Hand each key to a function while the block runs; questions are answered all the same."""
        with keys_heard(pressed) as self._keyboard:
            try:
                yield
            finally:
                self._keyboard = None

    def require_somebody(self) -> None:
        """Raise `NotConfirmed` where there is nobody who could be asked."""
        if not self.has_somebody:
            raise _not_confirmed()

    def require_yes(self, question: str, *, yes: bool) -> None:
        """Go on only with the operator's yes, given before or now; raises `NotConfirmed`."""
        if not yes and not self.asks(question):
            raise _not_confirmed()

    @contextmanager
    def telling(self, text: str) -> Iterator[Callable[[str], None]]:
        """Shows on a terminal, from a second on, what the block is at and how long it has taken.

        Gives what changes it.
        """
        if not self._talk.is_terminal:
            yield lambda _news: None
            return
        began_s, now_at, over = monotonic(), text, Event()

        def shown() -> Text:
            return Text(f"{now_at} · {monotonic() - began_s:.0f} s")

        def draw() -> None:
            if not over.wait(SILENT_S):
                live.start(refresh=True)
            while not over.wait(REDRAWN_S):
                live.refresh()

        def tell(news: str) -> None:
            nonlocal now_at
            now_at = news
            if live.is_started:
                live.refresh()

        live = Live(console=self._talk, transient=True, auto_refresh=False, get_renderable=shown)
        drawing = Thread(target=draw)
        drawing.start()
        try:
            yield tell
        finally:
            over.set()
            drawing.join()
            live.stop()

    def watching(self, title: str, *, plain: bool = False) -> RunDisplay:
        """Shows a run while the block runs; `plain` by lines."""
        return RunDisplay(self._talk, title, now_s=monotonic, verbose=self._verbose, plain=plain)
