"""A system that lacks what Windows lacks of POSIX: `pytest -p without_posix`, or a program.

Modules cannot be imported, attributes are gone, and no folder can be opened to be synchronised. The
locks stay: on Windows filelock has others. The program runs commands in such a system: it reads
their words as JSON from standard input, and stops at one that does not end with 0.
"""

import errno
import importlib.abc
import json
import os
import signal
import sys
import warnings
from pathlib import Path

# Both have other modules on Windows, and here need theirs before they are taken away.
import filelock  # noqa: F401
import pytest
import serial  # noqa: F401

MODULES = ("fcntl", "termios", "tty", "pty", "grp", "pwd", "resource", "syslog")
ATTRIBUTES = {
    os: (
        *("O_NOFOLLOW", "O_DIRECTORY", "O_NONBLOCK", "O_CLOEXEC", "geteuid", "getpgrp", "killpg"),
        *("mkfifo", "nice", "openpty", "setsid", "tcgetpgrp", "ttyname"),
    ),
    signal: (
        *("SIGALRM", "SIGHUP", "SIGQUIT", "SIGTSTP", "SIGUSR1", "ITIMER_REAL", "setitimer"),
        *("pthread_sigmask", "SIG_UNBLOCK"),
    ),
}
OURS = r"(app|campaigns|drivers|sim|pkmcal)(\.|$)"
"""Modules that must name the encoding of every text, with `-X warn_default_encoding`."""


class Absent(importlib.abc.MetaPathFinder):
    """Finder that is asked before all others, and has none of these modules."""

    def find_spec(self, fullname, path, target=None):
        if fullname in MODULES:
            raise ModuleNotFoundError(f"No module named '{fullname}'", name=fullname)


def take_away():
    """Take all of it away from this process, for good."""
    sys.meta_path.insert(0, Absent())
    for name in MODULES:
        sys.modules.pop(name, None)
    for module, names in ATTRIBUTES.items():
        for name in names:
            delattr(module, name)
    open_anything = os.open

    def open_file(path, flags, *arguments, **options):
        if "dir_fd" not in options and Path(path).is_dir():
            raise PermissionError(errno.EACCES, "Permission denied", os.fspath(path))
        return open_anything(path, flags, *arguments, **options)

    os.open = open_file


@pytest.hookimpl(tryfirst=True)
def pytest_load_initial_conftests():
    """Take it away before conftest.py imports what is tested."""
    take_away()


def main():
    """Run the commands, and end with the code of the last."""
    take_away()
    warnings.filterwarnings("error", category=EncodingWarning, module=OURS)
    from app.main import run_command
    from app.streams import make_streams_last

    make_streams_last()
    for words in json.load(sys.stdin):
        if code := run_command(words):
            sys.exit(code)


if __name__ == "__main__":
    main()
