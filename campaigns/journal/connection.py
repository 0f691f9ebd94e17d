"""Opens the journal's file: ours, of a version we know, durable, one commit a statement."""

import os
import sqlite3
from collections.abc import Callable
from pathlib import Path

from campaigns.errors import JournalFailed
from campaigns.journal import schema
from campaigns.journal.faults import explained

_LOCK_PATIENCE_S = 2.0


def connect_to_write(path: Path, *, create: bool) -> sqlite3.Connection:
    """Open a connection in autocommit mode; the caller closes it. Raises `JournalFailed`."""
    if not create:
        _check_there(path)

    def prepare(connection: sqlite3.Connection) -> None:
        blank = create and schema.is_blank(connection)
        if not blank:
            _check_ours(connection, path)
        _make_durable(connection, path)
        if blank:
            schema.create(connection)
        schema.upgrade(connection)

    return _connect(path, "rwc" if create else "rw", prepare)


def connect_to_read(path: Path) -> sqlite3.Connection:
    """Open a connection that refuses to write; the caller closes it. Raises `JournalFailed`.

    The file is opened for writing where it can be: only then does SQLite clear its -wal and -shm
    files away at the end. On a medium that cannot be written the bare file is read.
    """
    _check_there(path)

    def prepare(connection: sqlite3.Connection) -> None:
        _check_ours(connection, path)
        schema.upgrade(connection)
        connection.execute("PRAGMA query_only = ON")

    if os.access(path.parent, os.W_OK) and os.access(path, os.W_OK):
        return _connect(path, "rw", prepare)
    _check_complete(path)
    return _connect(path, "ro&immutable=1", prepare)


def _connect(
    path: Path, mode: str, prepare: Callable[[sqlite3.Connection], None]
) -> sqlite3.Connection:
    address = f"{path.resolve().as_uri()}?mode={mode}"
    with explained(path, "the journal cannot be opened"):
        connection = sqlite3.connect(
            address, uri=True, isolation_level=None, timeout=_LOCK_PATIENCE_S
        )
        try:
            prepare(connection)
        except BaseException:
            connection.close()
            raise
    return connection


def _check_there(path: Path) -> None:
    if not path.is_file():
        raise JournalFailed(
            f"{path}: there is no journal", remedy="measure first (`run`), or `import` shots"
        )


def _check_complete(path: Path) -> None:
    remains = path.with_name(f"{path.name}-wal")
    if remains.exists() and remains.stat().st_size:
        raise JournalFailed(
            f"{path}: the latest records are in {remains.name}, and the folder is write-protected",
            remedy="copy the campaign folder to where you may write, and open it there",
        )


def _check_ours(connection: sqlite3.Connection, path: Path) -> None:
    """Comes before anything is written: a file that is not ours is left as it was."""
    found = schema.version(connection)
    if schema.application_id(connection) != schema.APPLICATION_ID or found < 1:
        raise JournalFailed(
            f"{path}: not a journal of pkmcal", remedy="name the campaign's own campaign.db"
        )
    if found > schema.VERSION:
        raise JournalFailed(
            f"{path}: made by a newer pkmcal (version {found}, known here: {schema.VERSION})",
            remedy="install the newer pkmcal; the file was left as it is",
        )


def _make_durable(connection: sqlite3.Connection, path: Path) -> None:
    mode: str = connection.execute("PRAGMA journal_mode = WAL").fetchone()[0]
    if mode != "wal":
        raise JournalFailed(
            f"{path}: the file system allows no write-ahead log (mode {mode!r})",
            remedy="put the campaign folder on a local disk",
        )
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute("PRAGMA fullfsync = ON")  # macOS: fsync alone stops at the drive's cache
