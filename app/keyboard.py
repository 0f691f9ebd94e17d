"""The one reader of the terminal's input: lines as answers, and keys while a run is shown."""

# A terminal gives its input to the thread that reads first. Two of them read in a run: one for
# single keys (pause, skip, stop), and the main thread when a question needs a whole line. A lock
# gives them turns: while a question is open, the thread waits. For a question the terminal is put
# back into its line mode, so that the operator sees and corrects what is typed, and then into the
# mode of single keys again. What was typed before a question is dropped: a key pressed for the run
# must never be the answer to "is the cell clear?".

import os
import re
import select
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from drivers.errors import Cancelled, LinkDown
from drivers.system import HAS_POSIX, drop_typed, read_single_keys, restore_mode, terminal_mode

LOOK_S = 0.1
"""How often the request to stop is looked at, and the end of a run."""
TYPED_BYTES = 4096
"""Longest answer."""
ESCAPE_SEQUENCE = re.compile(r"\x1b(\[[0-?]*[ -/]*[@-~]|O?.)?", re.DOTALL)
"""Arrow, function and keypad keys, a letter with Alt, answers of the terminal: ECMA-48, 5.4."""


class Keyboard:
    """Reader of stdin. Answers and keys take turns, so that neither takes the other's letters."""

    def __init__(self) -> None:
        self._turn = threading.Lock()
        self._line_mode: list[Any] | None = None
        """Mode of the terminal for whole lines, kept while single keys are read; None otherwise."""

    @property
    def has_somebody(self) -> bool:
        """Whether there is a terminal at which somebody can answer."""
        return sys.stdin is not None and sys.stdin.isatty()

    def line(
        self, show_question: Callable[[], None], stop_requested: Callable[[], bool] = lambda: False
    ) -> str:
        """Show a question and return the line typed after it; earlier input is dropped.

        Raise `Cancelled` once a stop is requested, and `LinkDown` if the terminal is closed, or if
        more is typed than any answer needs.
        """
        typed = b""
        with self._turn, self._by_lines():
            show_question()
            # by pieces with a timeout rather than by readline, which no request to stop would end
            while b"\n" not in typed:
                if stop_requested():
                    raise Cancelled("the question was abandoned", remedy="start again when ready")
                if not _is_typed(LOOK_S):
                    continue
                piece = _read()
                typed += piece
                if not piece or len(typed) > TYPED_BYTES:
                    raise LinkDown("no answer: the terminal was closed", remedy="run it again")
        return typed.partition(b"\n")[0].decode("utf-8", errors="replace").strip()

    @contextmanager
    def keys(self, pressed: Callable[[str], None]) -> Iterator[None]:
        """Pass each key to a function, by a thread, for the time of the block.

        Without a terminal in the foreground no keys are read. Ctrl-C and Ctrl-Z stay signals.
        """
        if not _in_foreground():
            yield
            return
        over = threading.Event()
        thread = threading.Thread(target=self._hear, args=(pressed, over), name="keys", daemon=True)
        self._line_mode = terminal_mode(sys.stdin.fileno())
        try:
            read_single_keys(sys.stdin.fileno())
            thread.start()
            yield
        finally:
            over.set()
            if thread.ident is not None:
                thread.join()
            restore_mode(sys.stdin.fileno(), self._line_mode)
            self._line_mode = None

    def _hear(self, pressed: Callable[[str], None], over: threading.Event) -> None:
        while not over.is_set():
            if not _is_typed(LOOK_S):
                continue
            # While this thread waited for its turn, a question may have read the input: look again,
            # because a read without input would block and hold the turn.
            with self._turn:
                keys = _read() if _is_typed(0.0) else None
            if keys == b"":
                return  # the terminal was closed
            text = (keys or b"").decode("utf-8", errors="ignore")
            for key in ESCAPE_SEQUENCE.sub("", text):
                pressed(key)

    @contextmanager
    def _by_lines(self) -> Iterator[None]:
        """Read input by whole lines within the block; drop what was typed before it."""
        restore_mode(sys.stdin.fileno(), self._line_mode)
        drop_typed(sys.stdin.fileno())
        try:
            yield
        finally:
            if self._line_mode is not None:
                read_single_keys(sys.stdin.fileno())


KEYBOARD = Keyboard()
"""The one keyboard of the process."""


def _is_typed(within_s: float) -> bool:
    """Return whether something is typed within a time; without POSIX only `_read` finds out."""
    if not HAS_POSIX:  # Windows waits for sockets alone; no robot is driven there
        return True
    return bool(select.select([sys.stdin], [], [], within_s)[0])


def _read() -> bytes:
    """Return what is typed; nothing once the terminal is closed."""
    try:
        return os.read(sys.stdin.fileno(), TYPED_BYTES)
    except OSError:
        return b""


def _in_foreground() -> bool:
    """Return whether this process may read the terminal."""
    # the system stops a background process that changes the terminal's mode (SIGTTOU)
    try:
        return sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except (AttributeError, OSError, ValueError):
        return False
