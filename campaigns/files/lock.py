"""Lock of a campaign: one process at a time, which says in the locked file who it is."""

import errno
import fcntl
import json
import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from filelock import lock_descriptor

from campaigns.errors import CampaignLocked, WriteFailed
from drivers.bounded_files import FileRefused, read_bounded

LOCK_FILE = "campaign.lock"
HOLDER_BYTES = 10_000
PATIENCE_S = 0.1
"""Longer than `lock_holder` looks whether the lock is free."""
WITHOUT_LOCKS = {errno.ENOSYS, errno.ENOTSUP, errno.ENOLCK}
"""Errors by which a file system says that it has no locks."""
NO_LOCKS = "this file system has no locks: move the campaign folder to a local disk"
REMEDIES = dict.fromkeys(WITHOUT_LOCKS, NO_LOCKS) | {
    errno.ELOOP: f"{LOCK_FILE} is a link: delete it",
    errno.EISDIR: f"{LOCK_FILE} is a folder: delete it",
}


@dataclass(frozen=True, slots=True)
class Holder:
    """Process that holds a campaign, by what it says of itself."""

    pid: int
    host: str
    since_utc: str

    @property
    def says(self) -> str:
        """Who it is, in words."""
        return f"process {self.pid} on {self.host}, since {self.since_utc}"


@contextmanager
def campaign_lock(folder: Path, *, now_utc: Callable[[], str]) -> Iterator[None]:
    """Hold the campaign for the time of the block; the system frees it when the process dies.

    Raises `CampaignLocked`, naming the holder, when another process (or another block of this one)
    has it, and `WriteFailed` when the folder cannot be written or its file system has no locks.
    """
    words = {"pid": os.getpid(), "host": socket.gethostname(), "since_utc": now_utc()}
    descriptor = -1
    try:
        flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW
        descriptor = os.open(folder / LOCK_FILE, flags, mode=0o666)
        _take(descriptor, folder)
        _require_record_locks(descriptor)
        os.ftruncate(descriptor, 0)
        os.write(descriptor, json.dumps(words).encode())
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


def _take(descriptor: int, folder: Path) -> None:
    """Lock the file; raises `CampaignLocked` if another keeps it for `PATIENCE_S`."""
    until_s = time.monotonic() + PATIENCE_S
    while not lock_descriptor(descriptor, blocking=False):
        if time.monotonic() >= until_s:
            holder = _noted_holder(folder)
            raise CampaignLocked(
                f"{folder}: another process works on this campaign: "
                f"{holder.says if holder else 'holder unknown'}",
                remedy="wait until it has finished, or stop it",
            )
        time.sleep(PATIENCE_S / 5)


def _require_record_locks(descriptor: int) -> None:
    """Raise `OSError` where the file system lacks the locks of records, which SQLite needs.

    SQLite itself would say that the database is locked. A network file system may keep its two
    kinds of locks in one place: what is merely held there is no error.
    """
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        fcntl.lockf(descriptor, fcntl.LOCK_UN)
    except OSError as error:
        if error.errno in WITHOUT_LOCKS:
            raise


def has_record_locks(file: Path) -> bool:
    """Return whether records of a file can be locked; true where the file cannot be read.

    Not for a file that this process has locked: closing another descriptor would free it.
    """
    with suppress(OSError):
        descriptor = os.open(file, os.O_RDONLY)
        try:
            _require_record_locks(descriptor)
        except OSError:
            return False
        finally:
            os.close(descriptor)
    return True


def lock_holder(folder: Path) -> Holder | None:
    """Return the process that works on the campaign now; None if there is none.

    A process that was killed leaves its words, but not the lock.
    """
    holder = _noted_holder(folder)
    if holder is None:
        return None
    try:
        descriptor = os.open(folder / LOCK_FILE, os.O_RDONLY | os.O_NOFOLLOW)
    except OSError:
        return None
    try:
        return None if lock_descriptor(descriptor, blocking=False) else holder
    except OSError:
        return None
    finally:
        os.close(descriptor)


def _noted_holder(folder: Path) -> Holder | None:
    """Return the holder by the words in the locked file, which may be missing for a moment."""
    try:
        words = json.loads(read_bounded(folder / LOCK_FILE, HOLDER_BYTES))
        return Holder(int(words["pid"]), str(words["host"]), str(words["since_utc"]))
    except (FileRefused, ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None
