"""What operating systems have in different ways, and what Windows lacks of POSIX.

All that needs locks of records, modes of a terminal, pseudo-terminals or certain signals asks here,
so that whatever needs none of them also works where there are none.
"""

import os
import re
import signal
from collections.abc import Callable
from contextlib import suppress
from errno import EISDIR, ELOOP
from pathlib import Path
from typing import Any

try:
    import fcntl
    import termios
    import tty
except ImportError:
    HAS_POSIX = False
else:
    HAS_POSIX = True
"""Whether a robot can be driven from here: by signals and keys that stop it at any time."""

IS_WINDOWS = os.name == "nt"
_UNFOLLOWED = getattr(os, "O_NOFOLLOW", 0)
_AS_BYTES = getattr(os, "O_BINARY", 0)
_RESERVED = re.compile(
    r"(con|prn|aux|nul|conin\$|conout\$|(com|lpt)[0-9¹²³])\s*(\..*)?", re.IGNORECASE
)
_OPENED_ELSEWHERE = {5, 32, 33}
"""Windows' numbers for access denied, a sharing violation and a locked region."""


def signals_of(*names: str) -> tuple[signal.Signals, ...]:
    """Return the signals of these names that the system has."""
    return tuple(getattr(signal, name) for name in names if hasattr(signal, name))


def unblock(signals: tuple[signal.Signals, ...]) -> None:
    """Unblock signals that the parent process may have blocked, where a system can block any."""
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, signals)


def is_root() -> bool:
    """Return whether this process may do anything, as root of a POSIX system."""
    return bool(getattr(os, "geteuid", lambda: 1)() == 0)


def open_unfollowed(path: Path, flags: int) -> int:
    """Open a file through no link and return its descriptor.

    Raise `OSError`, by ELOOP for a link and EISDIR for a folder.
    """
    # Without the system's flag somebody could put a link there in between.
    if not _UNFOLLOWED and path.is_symlink():
        raise OSError(ELOOP, os.strerror(ELOOP), str(path))
    try:
        return os.open(path, flags | _UNFOLLOWED | _AS_BYTES, mode=0o666)
    except PermissionError as error:
        if not path.is_dir():  # which Windows reports as a file that is not ours
            raise
        raise IsADirectoryError(EISDIR, os.strerror(EISDIR), str(path)) from error


def require_record_locks(descriptor: int) -> None:
    """Raise `OSError` where a file's records cannot be locked, or are locked by another process.

    Windows locks parts of files on all its file systems.
    """
    if HAS_POSIX:
        fcntl.lockf(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        fcntl.lockf(descriptor, fcntl.LOCK_UN)


def is_open_elsewhere(error: OSError) -> bool:
    """Return whether Windows refused a file because another program has it open."""
    return getattr(error, "winerror", None) in _OPENED_ELSEWHERE


def problem_on_windows(name: str) -> str | None:
    """Return why Windows cannot have a file or folder of this name; None if it can."""
    if _RESERVED.fullmatch(name):
        return "is a name of a device of Windows"
    if name.endswith((".", " ")) and name.strip("."):
        return "ends with a dot or a space, which Windows drops"
    if signs := sorted(set(name) & set('<>:"|?*')):
        return f"has {' '.join(signs)}, which Windows does not take in names"
    return None


# A terminal that is gone, or none, has no mode: there is nothing to be restored.


def terminal_mode(descriptor: int) -> list[Any] | None:
    """Return the mode of a terminal; None where it has none."""
    if not HAS_POSIX:
        return None
    try:
        return termios.tcgetattr(descriptor)
    except termios.error:
        return None


def restore_mode(descriptor: int, mode: list[Any] | None) -> None:
    """Give a terminal an earlier mode, unless it is gone."""
    if HAS_POSIX and mode is not None:
        _ignoring_loss(termios.tcsetattr, descriptor, termios.TCSANOW, mode)


def read_single_keys(descriptor: int) -> None:
    """Let a terminal give keys without Enter and echo, unless it is gone; Ctrl-C is a signal."""
    if HAS_POSIX:
        _ignoring_loss(tty.setcbreak, descriptor, termios.TCSANOW)


def drop_typed(descriptor: int) -> None:
    """Drop what was typed at a terminal and is not read yet."""
    if HAS_POSIX:
        _ignoring_loss(termios.tcflush, descriptor, termios.TCIFLUSH)


def raw_pseudo_terminal() -> tuple[int, int]:
    """Open a pseudo-terminal that changes no byte; return its device's and its client's end."""
    device_end, client_end = os.openpty()
    tty.setraw(client_end)
    return device_end, client_end


def _ignoring_loss(step: Callable[..., object], *arguments: object) -> None:
    """Take a step at a terminal that may be gone."""
    with suppress(termios.error):
        step(*arguments)
