"""SQLite's errors in the operator's words."""

import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from campaigns.errors import JournalFailed

_PRIMARY_CODE = 0xFF
"""SQLite's extended error codes keep their family in the lowest byte."""

_AGAIN = "start the command again, and report this if it comes back"
_RIGHTS = "give this user the right to write the campaign folder and its files"
_OTHER_PROGRAM = "close the other program that has the journal open, then start again: it resumes"
_REMEDIES: Mapping[int, str] = {
    sqlite3.SQLITE_FULL: "free space on the disk, then start the command again: it resumes",
    sqlite3.SQLITE_IOERR: "check the disk and the space left on it, then start again: it resumes",
    sqlite3.SQLITE_BUSY: _OTHER_PROGRAM,
    sqlite3.SQLITE_LOCKED: _OTHER_PROGRAM,
    sqlite3.SQLITE_READONLY: _RIGHTS,
    sqlite3.SQLITE_PERM: _RIGHTS,
    sqlite3.SQLITE_CANTOPEN: "check that the folder exists and that this user may write it",
    sqlite3.SQLITE_NOTADB: "name the campaign's own campaign.db, or bring it back from a backup",
    sqlite3.SQLITE_CORRUPT: "keep the damaged file and bring campaign.db back from a backup",
    sqlite3.SQLITE_CONSTRAINT: f"nothing was written; {_AGAIN}",
}


@contextmanager
def explained(path: Path, what: str) -> Iterator[None]:
    """Turn any SQLite error inside into `JournalFailed`; `what` says what did not work."""
    try:
        yield
    except sqlite3.Error as error:
        raise JournalFailed(f"{path}: {what}: {error}", remedy=_remedy(error)) from error


def _remedy(error: sqlite3.Error) -> str:
    code: int | None = getattr(
        error, "sqlite_errorcode", None
    )  # absent when Python itself complains
    return _AGAIN if code is None else _REMEDIES.get(code & _PRIMARY_CODE, _AGAIN)
