"""Files of a journal: watched while they are written, and rescued into copies if they are lost.

On Unix a file that is deleted or renamed over lives on for the process that has it open. SQLite
would write an hour of shots into it without an error, and all of them would vanish when the process
ends.
"""

import os
import sqlite3
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path

from campaigns.errors import JournalFailed

FROM_BACKUP = "move campaign.db and campaign.db-wal away, and bring campaign.db back from a backup"
FileStates = dict[Path, os.stat_result | None]


class FilesChanged(JournalFailed):
    """Error of files that others deleted, replaced or cut while this process worked with them."""


def file_states(path: Path) -> FileStates:
    """Return the state of a journal's database and log; None for a file that is not there."""
    return {file: _state(file) for file in (path, log_of(path))}


def require_same(before: FileStates, now: FileStates, has_all: Callable[[], bool]) -> None:
    """Raise `FilesChanged` if a file was deleted, replaced or cut in between.

    Another program's checkpoint makes a file shorter, too: then `has_all` reads it.
    """
    # The order is from the harmless to the severe, for the remedies differ: a folder that was
    # renamed has all records, a file that was deleted or replaced has to be brought back. Times and
    # links are not compared: a `touch`, a viewer or a backup by hard links would stop a sound run.
    for path, earlier in before.items():
        later = now[path]
        if earlier is None:  # the log is made with the first record
            continue
        if not path.parent.exists():
            raise FilesChanged(
                f"{path.parent}: was renamed or moved away while this process worked with it",
                remedy="start again with the folder's new name: all records are in it",
            )
        if later is None:
            raise _change_error(path, "was deleted or moved away")
        # Device and inode are the file itself, whatever its name.
        if (later.st_dev, later.st_ino) != (earlier.st_dev, earlier.st_ino):
            raise _change_error(path, "was replaced by another file")
        if later.st_size < earlier.st_size and not has_all():
            raise _change_error(path, f"was cut from {earlier.st_size} to {later.st_size} bytes")


def _state(path: Path) -> os.stat_result | None:
    with suppress(OSError):
        return path.stat()
    return None


def _change_error(path: Path, how: str) -> FilesChanged:
    return FilesChanged(
        f"{path}: {how} while this process worked with it",
        remedy=f"find out which program did it; {FROM_BACKUP}",
    )


def log_of(path: Path) -> Path:
    """Return the write-ahead log that SQLite keeps beside a journal."""
    return path.with_name(f"{path.name}-wal")


def close_untouched(connection: sqlite3.Connection, path: Path) -> None:
    """Close a connection without moving the log into the database.

    Moved into a database that another program has changed, it would mix the pages of both.
    """
    # SQLite moves the log when its last connection closes. So a second one that may only read is
    # opened first, and closed after it: then ours is not the last, and the other cannot write.
    log = _state(log_of(path))
    if log is not None and log.st_size:
        with suppress(OSError, sqlite3.Error):
            address = f"{path.resolve().as_uri()}?mode=ro"
            with closing(sqlite3.connect(address, uri=True)) as bystander:
                # A connection takes part only once it has read; a damaged file may refuse even
                # that.
                with suppress(sqlite3.Error):
                    bystander.execute("SELECT count(*) FROM sqlite_master").fetchone()
                connection.close()
    connection.close()  # a second time does nothing; the first, where there was no log


def next_rescued_copy(path: Path) -> Path:
    """Return the first free name for a rescued copy beside a journal."""
    number = 1
    while (copy := path.with_name(f"{path.stem}-rescued-{number}{path.suffix}")).exists():
        number += 1
    return copy


def rescued_copies(path: Path) -> list[Path]:
    """Return the rescued copies beside a journal, the latest first."""
    copies = path.parent.glob(f"{path.stem}-rescued-*{path.suffix}")
    return sorted(copies, key=lambda copy: (len(copy.name), copy.name), reverse=True)


def take_rescued(name: str) -> str:
    """Return the remedy in words: how to go on with a rescued copy."""
    return (
        f"move campaign.db and campaign.db-wal away, rename {name} to campaign.db, and start "
        "again: it resumes"
    )
