"""The journal's file during a run: whether it is still the one at its path, and untouched."""

import sqlite3
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path

from campaigns.errors import JournalFailed

LOG, INDEX = "-wal", "-shm"
RESCUED = "-rescued"


@dataclass(frozen=True, slots=True)
class _Stamp:
    """What the system says of a file. `size` and `changed_ns` change with every write."""

    device: int
    inode: int
    links: int
    size: int
    changed_ns: int


class OwnFile:
    """A journal's database, write-ahead log and index, as this process alone writes them.

    Others may read them with SQLite: that changes nothing while the writer has them open. Files are
    looked at by name only: closing one that SQLite has open would free the process's locks on it.
    """

    def __init__(self, path: Path) -> None:
        self._written = (path, path.with_name(path.name + LOG))
        self._index = path.with_name(path.name + INDEX)
        self._index_seen = _stamp(self._index)
        self._seen = self._look()

    def check(self) -> None:
        """Raise `JournalFailed` when anything has been changed since the last own write."""
        for path, then, now in zip(self._written, self._seen, self._look(), strict=True):
            if now is not None and now.links > 1:
                raise _linked(path, now.links)
            if then != now:
                raise _changed(path, _difference(then, now))
        self._check_index()

    def settle(self) -> None:
        """Take the files as they are after an own write; raises when they are others by then."""
        found = self._look()
        for path, then, now in zip(self._written, self._seen, found, strict=True):
            if now is None or (then is not None and _identity(then) != _identity(now)):
                raise _changed(path, _difference(then, now))
        self._seen = found

    def _check_index(self) -> None:
        """The index in memory is written all the time: only which file it is can be compared."""
        now = _stamp(self._index)
        if self._index_seen is None:
            self._index_seen = now
        elif now is None or _identity(now) != _identity(self._index_seen):
            raise _changed(self._index, _difference(self._index_seen, now))

    def _look(self) -> tuple[_Stamp | None, _Stamp | None]:
        path, log = self._written
        return _stamp(path), _stamp(log)


def rescue(
    connection: sqlite3.Connection, path: Path, is_whole: Callable[[Path], bool]
) -> Path | None:
    """Copy of the records that the connection still sees, beside the file; None if not whole."""
    copy = _free_name(path)
    try:
        connection.execute("VACUUM INTO ?", (str(copy),))
    except sqlite3.Error:
        copy.unlink(missing_ok=True)
        return None
    if is_whole(copy):
        return copy
    copy.unlink(missing_ok=True)
    return None


def close_untouched(connection: sqlite3.Connection, path: Path) -> None:
    """Close without moving the log into the database, which would mix it with what others wrote.

    The last connection does that when it closes, but one that may only read cannot.
    """
    address = f"{path.resolve().as_uri()}?mode=ro"
    with suppress(sqlite3.Error), closing(sqlite3.connect(address, uri=True)) as bystander:
        with suppress(sqlite3.Error):
            bystander.execute("SELECT count(*) FROM sqlite_master").fetchone()
        connection.close()
    connection.close()


def _stamp(path: Path) -> _Stamp | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return _Stamp(found.st_dev, found.st_ino, found.st_nlink, found.st_size, found.st_mtime_ns)


def _identity(stamp: _Stamp) -> tuple[int, int]:
    return stamp.device, stamp.inode


def _difference(then: _Stamp | None, now: _Stamp | None) -> str:
    if now is None:
        return "was deleted or moved away"
    if then is None or _identity(then) != _identity(now):
        return "was replaced by another file"
    if now.size < then.size:
        return f"was cut from {then.size} to {now.size} bytes"
    return "was changed by another program"


def _changed(path: Path, how: str) -> JournalFailed:
    return JournalFailed(
        f"{path}: {how} while this process worked with it",
        remedy="find out which program did it; bring campaign.db back from a backup",
    )


def _linked(path: Path, links: int) -> JournalFailed:
    return JournalFailed(
        f"{path}: has {links} names (hard links), and may have 1: by another name SQLite would "
        "write another log",
        remedy="keep a copy in place of the link, then start again: it resumes",
    )


def _free_name(path: Path) -> Path:
    taken = 1
    while (copy := path.with_name(f"{path.stem}{RESCUED}-{taken}{path.suffix}")).exists():
        taken += 1
    return copy
