"""Standard streams that outlast their readers, and write UTF-8 whatever the terminal's code page.

A run must not end because its output is no longer read: a closed pipe is no wish to stop the
robot, nor to leave it without supervision.
"""

import errno
import io
import json
import os
import sys
from collections.abc import Container, Mapping
from typing import TYPE_CHECKING, TextIO

from app.exits import AnswerLost

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

READER_GONE = frozenset({errno.EPIPE, errno.EIO, errno.ENXIO, errno.ECONNRESET, errno.EBADF})
"""A pipe's reader has left, a terminal was closed."""

FULL_HEIGHT = 24
"""Lines of a screen that has room for headings and tables, not for what matters most alone."""


class LastingStream(io.RawIOBase):
    """Stream that drops its bytes once the stream behind it cannot be written any more.

    An error whose number is not in `borne` is raised once, as `AnswerLost`; None: no error is.
    """

    def __init__(self, name: str, inner: io.RawIOBase, borne: Container[int] | None) -> None:
        super().__init__()
        self._name = name
        self._inner = inner
        self._borne = borne
        self._is_of_use = True

    def writable(self) -> bool:
        """Return whether it can be written to: always."""
        return True

    def isatty(self) -> bool:
        """Return whether it is a terminal."""
        return self._inner.isatty()

    def fileno(self) -> int:
        """Return the descriptor of the file behind it."""
        return self._inner.fileno()

    def write(self, data: "ReadableBuffer", /) -> int | None:
        """Write or drop the bytes, and return their number."""
        # After the first error nothing is tried again. Dropped bytes count as written: Python's
        # buffers would keep them otherwise, and raise the error again when the process ends.
        size = memoryview(data).nbytes
        if not self._is_of_use:
            return size
        try:
            return self._inner.write(data)
        except OSError as error:
            self._is_of_use = False
            if self._borne is None or error.errno in self._borne:
                return size
            raise AnswerLost(
                f"{self._name} cannot be written ({os.strerror(error.errno or 0).lower()})",
                remedy="free space there, then ask again",
            ) from error


def lasting(stream: TextIO, name: str, borne: Container[int] | None) -> TextIO:
    """Return a lasting stream in UTF-8; one that has no bytes behind it stays as it is."""
    buffered = getattr(stream, "buffer", None)
    raw = getattr(buffered, "raw", buffered)  # Python's own streams may be unbuffered
    if not isinstance(raw, io.RawIOBase):
        return stream
    stream.flush()
    return io.TextIOWrapper(
        io.BufferedWriter(LastingStream(name, raw, borne)),
        encoding="utf-8",
        errors="backslashreplace",  # names of files need not be UTF-8
        line_buffering=raw.isatty(),
        write_through=True,
    )


def make_streams_last() -> None:
    """Make the process's streams last. Lost talk is no error; an answer that finds no room is."""
    # stdout: a reader who has left wanted no more, but a full disk lost an answer, which a script
    # would miss. stderr: there is no place left to report the loss at. A stream is None where the
    # process was started without it.
    if sys.stdout is not None:
        sys.stdout = lasting(sys.stdout, "standard output", READER_GONE)
    if sys.stderr is not None:
        sys.stderr = lasting(sys.stderr, "standard error", None)


def print_document(document: Mapping[str, object]) -> None:
    """Print a command's one document for programs on standard output."""
    if sys.stdout is not None:
        sys.stdout.write(f"{json.dumps(document, allow_nan=False)}\n")
        sys.stdout.flush()
