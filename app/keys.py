"""Keys that the operator presses while it is measured, each heeded without Enter."""

import os
import select
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress


@contextmanager
def keys_heard(pressed: Callable[[str], None]) -> Iterator[bool]:
    """Hand each key to a function, from a thread of its own, for the time of the block.

    False, and nothing is heard, without a terminal in the foreground. Ctrl-C and Ctrl-Z stay what
    they are.
    """
    if sys.platform == "win32" or not _in_foreground():
        yield False
        return
    import termios  # there is none on Windows
    import tty

    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    ending, end = os.pipe()
    thread = threading.Thread(
        target=_listen, args=(terminal, ending, pressed), name="keys", daemon=True
    )
    try:
        tty.setcbreak(terminal, termios.TCSANOW)
        thread.start()
        yield True
    finally:
        os.close(end)
        if thread.ident is not None:
            thread.join()
        os.close(ending)
        with suppress(termios.error):  # the terminal may be gone
            termios.tcsetattr(terminal, termios.TCSANOW, before)


def _listen(terminal: int, ending: int, pressed: Callable[[str], None]) -> None:
    while True:
        ready, _, _ = select.select([terminal, ending], [], [])
        if ending in ready:
            return
        try:
            typed = os.read(terminal, 64)
        except OSError:
            return
        if not typed:
            return
        for key in typed.decode("utf-8", errors="ignore"):
            pressed(key)


def _in_foreground() -> bool:
    """Whether somebody types here: a process in the background would be stopped for asking."""
    try:
        terminal = sys.stdin.fileno()
        return sys.stdin.isatty() and os.tcgetpgrp(terminal) == os.getpgrp()
    except (AttributeError, OSError, ValueError):
        return False
