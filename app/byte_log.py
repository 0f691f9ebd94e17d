"""The byte log that `--spy FILE` asks for."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from app.console import WARNING, Terminal
from campaigns.campaign import now_utc
from campaigns.errors import WriteFailed
from campaigns.files.text_file import refuse_existing
from drivers.byte_log import ByteLog


@contextmanager
def byte_log(path: Path | None, terminal: Terminal) -> Iterator[ByteLog | None]:
    """A log in a new file for the time of the block, or none.

    Raises `OutputExists` or `WriteFailed`; a log that cannot go on is said, and the work goes on.
    """
    if path is None:
        yield None
        return
    refuse_existing(path)
    try:
        file = path.open("x", encoding="utf-8")
    except OSError as error:
        raise WriteFailed(
            f"{path}: cannot be written ({error.strerror})", remedy="name another file"
        ) from error
    with file:
        log = ByteLog(file, now_utc=now_utc)
        try:
            yield log
        finally:
            if log.problem:
                terminal.note(f"the byte log is not complete: {log.problem}", WARNING)
