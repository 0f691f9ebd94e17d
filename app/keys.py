"""Keys that the operator presses while the robot measures, and lines that he types as answers."""

import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue

from drivers.errors import Cancelled, LinkDown

LOOK_S = 0.1
"""How often a question looks at the wish to stop."""
TYPED_BYTES = 4096


class Keyboard:
    """The only reader of a terminal's input: single keys, or whole lines while a question is open.

    `run` belongs to a thread of its own, which ends when the other end of `ending` is closed.
    """

    def __init__(self, terminal: int, pressed: Callable[[str], None]) -> None:
        self._terminal, self._pressed = terminal, pressed
        self._line_mode = termios.tcgetattr(terminal)
        self._turn = threading.Lock()
        self._lines: SimpleQueue[bytes] | None = None
        self._is_closed = False
        tty.setcbreak(terminal, termios.TCSANOW)
        self._key_mode = termios.tcgetattr(terminal)

    def run(self, ending: int) -> None:
        """Hand on what is typed, until the end or until the terminal is closed."""
        while ending not in select.select([self._terminal, ending], [], [])[0]:
            with self._turn:
                if not select.select([self._terminal], [], [], 0.0)[0]:
                    continue  # it was dropped, or answered a question, meanwhile
                try:
                    typed = os.read(self._terminal, TYPED_BYTES)
                except OSError:
                    typed = b""
                if self._lines is not None:
                    self._lines.put(typed)
                else:
                    for key in typed.decode("utf-8", errors="ignore"):
                        self._pressed(key)
            if not typed:
                self._is_closed = True
                return

    @contextmanager
    def lines(self) -> Iterator[Callable[[Callable[[], bool]], str]]:
        """Read lines instead of keys in the block; what was typed before it is dropped.

        Give the function that waits for a line, as `typed_line` does.
        """
        with self._turn:
            self._lines = lines = SimpleQueue[bytes]()
            termios.tcsetattr(self._terminal, termios.TCSANOW, self._line_mode)
            termios.tcflush(self._terminal, termios.TCIFLUSH)

        def next_piece() -> bytes | None:
            with suppress(Empty):
                return lines.get(timeout=LOOK_S)
            return b"" if self._is_closed else None

        try:
            yield lambda stop_requested: typed_line(next_piece, stop_requested)
        finally:
            with self._turn:
                self._lines = None
                with suppress(termios.error):  # the terminal may be gone
                    termios.tcsetattr(self._terminal, termios.TCSANOW, self._key_mode)

    def leave(self) -> None:
        """Put the terminal back into the mode in which it was."""
        with suppress(termios.error):  # the terminal may be gone
            termios.tcsetattr(self._terminal, termios.TCSANOW, self._line_mode)


@contextmanager
def keys_heard(pressed: Callable[[str], None]) -> Iterator[Keyboard | None]:
    """Hand each key to a function, from a thread of its own, for the time of the block.

    None, and nothing is heard, without a terminal in the foreground. Ctrl-C and Ctrl-Z stay what
    they are.
    """
    if not _in_foreground():
        yield None
        return
    keyboard = Keyboard(sys.stdin.fileno(), pressed)
    ending, end = os.pipe()
    thread = threading.Thread(target=keyboard.run, args=(ending,), name="keys", daemon=True)
    try:
        thread.start()
        yield keyboard
    finally:
        os.close(end)
        if thread.ident is not None:
            thread.join()
        os.close(ending)
        keyboard.leave()


def typed_line(next_piece: Callable[[], bytes | None], stop_requested: Callable[[], bool]) -> str:
    """Return the first line that is typed; `next_piece` gives None while nothing is.

    A signal alone ends no reading, so the wish to stop is looked at: raises `Cancelled`, and
    `LinkDown` when the terminal is closed.
    """
    typed = b""
    while b"\n" not in typed:
        if stop_requested():
            raise Cancelled("the question was abandoned", remedy="start again when ready")
        piece = next_piece()
        if piece is None:
            continue
        typed += piece
        if not piece or len(typed) > TYPED_BYTES:
            raise LinkDown("no answer: the terminal was closed", remedy="run it again")
    return typed.partition(b"\n")[0].decode("utf-8", errors="replace").strip()


def _in_foreground() -> bool:
    """Whether somebody types here: a process in the background would be stopped for asking."""
    try:
        terminal = sys.stdin.fileno()
        return sys.stdin.isatty() and os.tcgetpgrp(terminal) == os.getpgrp()
    except (AttributeError, OSError, ValueError):
        return False
