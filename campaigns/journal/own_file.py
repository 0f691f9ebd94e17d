"""The journal's file during a run: whether it is still the one at its path, and untouched."""

import sqlite3
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import NamedTuple

from campaigns.errors import JournalFailed
from campaigns.journal.digest_chain import FROM_BACKUP

LOG, INDEX = "-wal", "-shm"
RESCUED = "-rescued"
LONG_LOG_BYTES = 4_000_000
"""Length from which the log is moved into the database."""
LOG_END_BYTES = 8192
"""More than the last page with its header: a log that was cut has a hole there once it grows."""


class _Stamp(NamedTuple):
    """What the system says of a file. `size` and `changed_ns` change with every write."""

    device: int
    inode: int
    links: int
    size: int
    changed_ns: int


class OwnFile:
    """A journal's database, write-ahead log and index, as this process alone writes them.

    Others may read them with SQLite: that changes nothing while the writer has them open. The
    database and the index are looked at by name only: closing a file that SQLite has open would
    free the process's locks on it. The log has none.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._log, self._index = (path.with_name(path.name + end) for end in (LOG, INDEX))
        self._index_seen = _stamp(self._index)
        self._take_note()

    def _take_note(self) -> None:
        self._path_seen, self._log_seen = _stamp(self._path), _stamp(self._log)
        self._log_end = _end(self._log, self._log_seen)
        self._log_is_own = not self._log_end

    def check(self) -> None:
        """Raise `JournalFailed` when anything has been changed since the last own write.

        The index in memory is written all the time: only which file it is can be compared.
        """
        _require(self._path, self._path_seen)
        _require(self._log, self._log_seen)
        if self._index_seen is None:
            self._index_seen = _stamp(self._index)
        else:
            _require(self._index, self._index_seen, written=True)

    def settle(self, digest: str) -> None:
        """Take note of an own write of a record with this digest.

        A write goes to the log alone, behind what is there. Raises `JournalFailed` when it does not
        stand there, or when anything else has been changed since the check before it.
        """
        _require(self._path, self._path_seen)
        _require(self._log, self._log_seen, written=True)
        before, found = self._log_end if self._log_is_own else b"", _stamp(self._log)
        added = _end(self._log, self._log_seen if self._log_is_own else None)
        if not added.startswith(before):
            raise _changed(self._log, "was cut or changed by another program")
        if digest.encode() not in added[len(before) :]:
            raise _changed(self._log, "lacks the record that was written just now")
        self._log_seen, self._log_end = found, added[-LOG_END_BYTES:]

    @property
    def wants_checkpoint(self) -> bool:
        """Whether it is time to move the log into the database: it is long, or not all its own.

        What a crash left behind its last record is written over, and what was moved while somebody
        read it is begun anew: such a log does not only grow.
        """
        return not self._log_is_own or (self._log_seen or _NONE).size > LONG_LOG_BYTES

    def settle_checkpoint(self) -> None:
        """Take note that the log was moved into the database and emptied, if no reader kept it."""
        _require(self._path, self._path_seen, written=True)
        _require(self._log, self._log_seen, written=True)
        self._take_note()


def rescue(
    connection: sqlite3.Connection, path: Path, is_whole: Callable[[Path], bool]
) -> Path | None:
    """Copy of the records that the connection still sees, beside the file; None if not whole."""
    taken = 1
    while (copy := path.with_name(f"{path.stem}{RESCUED}-{taken}{path.suffix}")).exists():
        taken += 1
    with suppress(sqlite3.Error):
        connection.execute("VACUUM INTO ?", (str(copy),))
        if is_whole(copy):
            return copy
    copy.unlink(missing_ok=True)
    return None


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
    address = f"{path.resolve().as_uri()}?mode=ro"
    with suppress(sqlite3.Error), closing(sqlite3.connect(address, uri=True)) as bystander:
        with suppress(sqlite3.Error):
            bystander.execute("SELECT count(*) FROM sqlite_master").fetchone()
        connection.close()
    connection.close()


def close_refused(connection: sqlite3.Connection, path: Path) -> None:
    """Close a file that was only looked at, and leave a log with records as it is beside it."""
    log = _stamp(path.with_name(path.name + LOG))
    if log is not None and log.size:
        close_untouched(connection, path)
    connection.close()


_NONE = _Stamp(0, 0, 0, 0, 0)


def _stamp(path: Path) -> _Stamp | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return _Stamp(found.st_dev, found.st_ino, found.st_nlink, found.st_size, found.st_mtime_ns)


def _end(log: Path, seen: _Stamp | None) -> bytes:
    """Contents of the log from a little before the size that was seen on.

    SQLite has no locks on it, so it may be opened and closed.
    """
    try:
        with log.open("rb") as file:
            file.seek(max(0, (seen or _NONE).size - LOG_END_BYTES))
            return file.read()
    except OSError:
        return b""


def _require(path: Path, then: _Stamp | None, *, written: bool = False) -> None:
    """Raise `JournalFailed` unless the file is the same, and untouched unless it was `written`."""
    now = _stamp(path)
    if now is not None and now.links > 1:
        raise JournalFailed(
            f"{path}: has {now.links} names (hard links), and may have 1: by another name SQLite "
            "would write another log",
            remedy="keep a copy in place of the link, then start again: it resumes",
        )
    if now == then and not (written and now is None):
        return
    if now is None:
        raise _changed(path, "was deleted or moved away")
    if then is None and written:
        return
    if then is None or (now.device, now.inode) != (then.device, then.inode):
        raise _changed(path, "was replaced by another file")
    if written:
        return
    if now.size < then.size:
        raise _changed(path, f"was cut from {then.size} to {now.size} bytes")
    raise _changed(path, "was changed by another program")


def _changed(path: Path, how: str) -> JournalFailed:
    return JournalFailed(
        f"{path}: {how} while this process worked with it",
        remedy=f"find out which program did it; {FROM_BACKUP}",
    )
