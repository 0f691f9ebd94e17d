"""The one reader of the terminal's input: lines as answers, and keys while a run is shown."""

import os
import re
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from drivers.errors import Cancelled, LinkDown

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
        """Mode of the terminal for whole lines, kept while keys are heard."""

    @property
    def has_somebody(self) -> bool:
        """Whether there is a terminal at which somebody can answer."""
        return sys.stdin is not None and sys.stdin.isatty()

    def line(
        self, show_question: Callable[[], None], stop_requested: Callable[[], bool] = lambda: False
    ) -> str:
        """Return the line that is typed once the question is shown; what was typed before is lost.

        Raise `Cancelled` once a stop is requested, and `LinkDown` if the terminal is closed.
        """
        typed = b""
        with self._turn, self._by_lines():
            show_question()
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
        """Hand each key to a function, by a thread, for the time of the block.

        Nothing is heard without a terminal in the foreground. Ctrl-C and Ctrl-Z stay what they are.
        """
        if not _in_foreground():
            yield
            return
        over = threading.Event()
        thread = threading.Thread(target=self._hear, args=(pressed, over), name="keys", daemon=True)
        self._line_mode = termios.tcgetattr(sys.stdin.fileno())
        try:
            tty.setcbreak(sys.stdin.fileno(), termios.TCSANOW)
            thread.start()
            yield
        finally:
            over.set()
            if thread.ident is not None:
                thread.join()
            with suppress(termios.error):  # the terminal may be gone
                termios.tcsetattr(sys.stdin.fileno(), termios.TCSANOW, self._line_mode)
            self._line_mode = None

    def _hear(self, pressed: Callable[[str], None], over: threading.Event) -> None:
        while not over.is_set():
            if not _is_typed(LOOK_S):
                continue
            with self._turn:  # a question may have taken what was typed
                keys = _read() if _is_typed(0.0) else None
            if keys == b"":
                return  # the terminal was closed
            text = (keys or b"").decode("utf-8", errors="ignore")
            for key in ESCAPE_SEQUENCE.sub("", text):
                pressed(key)

    @contextmanager
    def _by_lines(self) -> Iterator[None]:
        """Read whole lines for the time of the block, and drop what waits to be read."""
        with suppress(termios.error):  # no terminal, or none any more
            if self._line_mode is not None:
                termios.tcsetattr(sys.stdin.fileno(), termios.TCSANOW, self._line_mode)
            termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)
        try:
            yield
        finally:
            if self._line_mode is not None:
                with suppress(termios.error):
                    tty.setcbreak(sys.stdin.fileno(), termios.TCSANOW)


KEYBOARD = Keyboard()
"""The process's own."""


def _is_typed(within_s: float) -> bool:
    return bool(select.select([sys.stdin], [], [], within_s)[0])


def _read() -> bytes:
    """Return what is typed; nothing once the terminal is closed."""
    try:
        return os.read(sys.stdin.fileno(), TYPED_BYTES)
    except OSError:
        return b""


def _in_foreground() -> bool:
    """Return whether somebody types here: a process in the background is stopped for asking."""
    try:
        return sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except (AttributeError, OSError, ValueError):
        return False
