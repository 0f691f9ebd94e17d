"""The journal's files during a run, and the copy of its records that is kept when they are lost."""

import os
import sqlite3
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path

from campaigns.errors import JournalFailed
from campaigns.journal.digest_chain import FROM_BACKUP

LOG = "-wal"
RESCUED = "-rescued"


class OwnFile:
    """Database and write-ahead log of a journal: the files that were opened, and no shorter.

    `is_whole` reads a journal that became shorter, as by a checkpoint of another program, and says
    whether all records are in it.
    """

    def __init__(self, path: Path, is_whole: Callable[[], bool]) -> None:
        self._path, self._is_whole = path, is_whole
        self._seen: dict[Path, os.stat_result] = {}
        self.check()

    def check(self) -> None:
        """Raise `JournalFailed` if a file was deleted, replaced or cut since the last check."""
        for path in (self._path, self._path.with_name(self._path.name + LOG)):
            before, now = self._seen.get(path), _stat(path)
            if before is not None:
                self._compare(path, before, now)
            if now is not None:
                self._seen[path] = now

    def _compare(self, path: Path, before: os.stat_result, now: os.stat_result | None) -> None:
        if not path.parent.exists():
            raise JournalFailed(
                f"{path.parent}: was renamed or moved away while this process worked with it",
                remedy="start again with the folder's new name: all records are in it, it resumes",
            )
        if now is None:
            raise _changed(path, "was deleted or moved away")
        if (now.st_dev, now.st_ino) != (before.st_dev, before.st_ino):
            raise _changed(path, "was replaced by another file")
        if now.st_size < before.st_size and not self._is_whole():
            raise _changed(path, f"was cut from {before.st_size} to {now.st_size} bytes")


def free_name(path: Path) -> Path:
    """Return the first free name for a rescued copy beside a journal."""
    taken = 1
    while (copy := path.with_name(f"{path.stem}{RESCUED}-{taken}{path.suffix}")).exists():
        taken += 1
    return copy


def rescued_copies(path: Path) -> list[Path]:
    """Copies of a journal that were rescued beside it, the latest first."""
    found = path.parent.glob(f"{path.stem}{RESCUED}-*{path.suffix}")
    return sorted(found, key=lambda copy: (len(copy.name), copy.name), reverse=True)


def take_rescued(name: str) -> str:
    """What to do to go on with a rescued copy."""
    return (
        f"move campaign.db and campaign.db-wal away, rename {name} to campaign.db, and start "
        "again: it resumes"
    )


def close_untouched(connection: sqlite3.Connection, path: Path) -> None:
    """Close without moving the log into the database, which would mix it with what others wrote.

    The last connection does that when it closes, but one that may only read cannot.
    """
    with suppress(OSError, sqlite3.Error):
        address = f"{path.resolve().as_uri()}?mode=ro"
        with closing(sqlite3.connect(address, uri=True)) as bystander:
            with suppress(sqlite3.Error):
                bystander.execute("SELECT count(*) FROM sqlite_master").fetchone()
            connection.close()
    connection.close()


def close_refused(connection: sqlite3.Connection, path: Path) -> None:
    """Close a file that was only looked at, and leave a log with records as it is beside it."""
    log = _stat(path.with_name(path.name + LOG))
    if log is not None and log.st_size:
        close_untouched(connection, path)
    connection.close()


def _stat(path: Path) -> os.stat_result | None:
    with suppress(OSError):
        return path.stat()
    return None


def _changed(path: Path, how: str) -> JournalFailed:
    return JournalFailed(
        f"{path}: {how} while this process worked with it",
        remedy=f"find out which program did it; {FROM_BACKUP}",
    )
