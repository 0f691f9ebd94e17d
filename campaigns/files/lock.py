"""Lock of a campaign folder: one process at a time writes into it, and others can name it.

The lock is the operating system's, on `campaign.lock`: as a whole (`flock`), and on Windows on its
first byte, a blank, which no other process can then read. It belongs to the open
file: the system frees it when the process ends, by whatever way, so no lock is ever left over and
none has to be broken by hand. The text in the file names the holder for error messages and for the
live page. A process that was killed leaves its text behind, so the text counts only while the file
is locked. The file stays in the folder: if a holder deleted it, a waiting process could lock the
deleted file while the next one locks a new file of that name, and both would write.
"""

import errno
import json
import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from campaigns.errors import CampaignLocked, WriteFailed
from drivers.bounded_files import FileRefused, open_file
from drivers.system import open_unfollowed, require_record_locks
from drivers.texts import moment

LOCK_FILE = "campaign.lock"
HOLDER_BYTES = 10_000
PATIENCE_S = 0.1
"""Wait for the lock: longer than `lock_holder` holds it to see whether it is free."""
WITHOUT_LOCKS = {errno.ENOSYS, errno.ENOTSUP, errno.ENOLCK}
"""Error numbers of file systems without locks."""
NO_LOCKS = "this file system has no locks: move the campaign folder to a local disk"
REMEDIES = dict.fromkeys(WITHOUT_LOCKS, NO_LOCKS) | {
    errno.ELOOP: f"{LOCK_FILE} is a link: delete it",
    errno.EISDIR: f"{LOCK_FILE} is a folder: delete it",
}


@dataclass(frozen=True, slots=True)
class Holder:
    """Process that holds a campaign, as it wrote itself into the locked file."""

    pid: int
    host: str
    since_utc: str

    @property
    def says(self) -> str:
        """Process, computer and time, in words."""
        return f"process {self.pid} on {self.host}, since {moment(self.since_utc)}"


@contextmanager
def campaign_lock(folder: Path, *, now_utc: Callable[[], str]) -> Iterator[None]:
    """Hold the campaign for the time of the block; the system frees it when the process dies.

    Raise `CampaignLocked`, naming the holder, when another process (or another block of this one)
    holds the campaign, and `WriteFailed` when the folder cannot be written or its file system has
    no locks.
    """
    # 1. Open the file, but through no link, which could lead to somebody's file to be emptied.
    # 2. Lock it; only from here on is the text in it ours to replace.
    # 3. Make sure that the journal's SQLite will find the other kind of lock that it needs.
    # 4. Write who holds the campaign.
    words = {"pid": os.getpid(), "host": socket.gethostname(), "since_utc": now_utc()}
    descriptor = -1
    try:
        descriptor = open_unfollowed(folder / LOCK_FILE, os.O_RDWR | os.O_CREAT)
        _acquire(descriptor, folder)
        _refuse_without_record_locks(descriptor)
        os.ftruncate(descriptor, 0)
        os.write(descriptor, f" {json.dumps(words)}".encode())
    except OSError as error:
        if descriptor >= 0 and error.errno in WITHOUT_LOCKS:
            (folder / LOCK_FILE).unlink(missing_ok=True)  # which no process can hold
        raise WriteFailed(
            f"{folder}: cannot be locked for this process: {error.strerror or error}",
            remedy=REMEDIES.get(
                error.errno or 0,
                "check that the folder exists, the right to write it, and the space on the disk",
            ),
        ) from error
    else:
        try:
            yield
        finally:
            with suppress(OSError):
                os.ftruncate(descriptor, 0)
    finally:
        if descriptor >= 0:
            os.close(descriptor)


def _takes_lock(descriptor: int) -> bool:
    """Lock an open file if no other one has the lock, and return whether this one has it now."""
    from filelock import lock_descriptor  # with logging, which most readers need not wait for

    return bool(lock_descriptor(descriptor, blocking=False))


# `lock_holder` of another process takes the lock for a moment to see whether it is free: try again.
def _acquire(descriptor: int, folder: Path) -> None:
    """Lock the file; raise `CampaignLocked` if another process keeps it for `PATIENCE_S`."""
    until_s = time.monotonic() + PATIENCE_S
    while not _takes_lock(descriptor):
        if time.monotonic() >= until_s:
            holder = _read_holder(folder)
            raise CampaignLocked(
                f"{folder}: another process works on this campaign: "
                f"{holder.says if holder else 'holder unknown'}",
                remedy="wait until it has finished, or stop it",
            )
        time.sleep(PATIENCE_S / 5)


def _refuse_without_record_locks(descriptor: int) -> None:
    """Raise `OSError` where the file system lacks the locks of records, which SQLite needs.

    SQLite itself would report a locked database, which would send the reader after a process that
    does not exist.
    """
    # A network file system may keep both kinds of locks in one place, where the lock that we hold
    # already refuses this one: only the errors of missing locks count.
    try:
        require_record_locks(descriptor)
    except OSError as error:
        if error.errno in WITHOUT_LOCKS:
            raise


def has_record_locks(file: Path) -> bool:
    """Return whether records of a file can be locked; true where the file cannot be read.

    Do not call this for a file that this process has locked: locks of records belong to process
    and file, so closing any descriptor of the file frees them all.
    """
    with suppress(OSError):
        descriptor = os.open(file, os.O_RDONLY)
        try:
            _refuse_without_record_locks(descriptor)
        except OSError:
            return False
        finally:
            os.close(descriptor)
    return True


def lock_holder(folder: Path) -> Holder | None:
    """Return the process that works on the campaign now; None if no process does."""
    # 1. read the text  2. try the lock: if it can be had, the text is that of a dead process
    holder = _read_holder(folder)
    if holder is None:
        return None
    try:
        descriptor = open_unfollowed(folder / LOCK_FILE, os.O_RDONLY)
    except OSError:
        return None
    try:
        return None if _takes_lock(descriptor) else holder
    except OSError:
        return None
    finally:
        os.close(descriptor)  # which frees the lock, if this look has taken it


def _read_holder(folder: Path) -> Holder | None:
    """Return the holder named in the file; None while its text is incomplete or no such text."""
    try:
        with open_file(folder / LOCK_FILE) as file:
            file.seek(1)  # after the blank, which Windows lets only the holder read
            words = json.loads(file.read(HOLDER_BYTES))
        return Holder(int(words["pid"]), str(words["host"]), str(words["since_utc"]))
    except (FileRefused, ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None
