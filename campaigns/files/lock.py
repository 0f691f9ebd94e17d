"""Lock of a campaign: one process at a time."""

import errno
import fcntl
import json
import os
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from campaigns.errors import CampaignLocked, WriteFailed
from drivers.bounded_files import FileRefused, read_bounded

LOCK_FILE = "campaign.lock"
HOLDER_FILE = "campaign.lock.holder"
"""A file of its own: older versions empty the lock file whenever they try it."""
HOLDER_BYTES = 10_000
SAME_CLOCK_S = 2.0
"""A process that began so much later than the note was written only has the same number."""
CHECK_THE_FOLDER = "check that the folder exists, the right to write it, and the space on the disk"
NO_LOCKS = "this file system has no locks: move the campaign folder to a local disk"
REMEDIES = {
    errno.ENOSYS: NO_LOCKS,
    errno.ENOTSUP: NO_LOCKS,
    errno.ENOLCK: NO_LOCKS,
    errno.EINTR: "a signal came between: start the command again",
}
"""Remedies by what the system says of a lock."""


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

    @property
    def is_gone(self) -> bool:
        """Whether it was of this machine and has died without taking its word back."""
        if self.host != socket.gethostname():
            return False
        import psutil  # for a lock that somebody holds

        try:
            begun_s: float = psutil.Process(self.pid).create_time()
            return begun_s > datetime.fromisoformat(self.since_utc).timestamp() + SAME_CLOCK_S
        except (psutil.NoSuchProcess, ValueError, OverflowError):
            return True
        except psutil.Error:
            return False


@contextmanager
def campaign_lock(folder: Path, *, now_utc: Callable[[], str]) -> Iterator[None]:
    """Hold the campaign for the time of the block; the system frees it when the process dies.

    Raises `CampaignLocked`, naming the holder, when another process (or another block of this one)
    has it, and `WriteFailed` when the folder cannot be written.
    """
    try:
        lock = _locked(folder / LOCK_FILE)
    except BlockingIOError as held:
        noted = _noted_holder(folder)
        held_by = noted.says if noted else "holder unknown"
        raise CampaignLocked(
            f"{folder}: another process works on this campaign: {held_by}",
            remedy="wait until it has finished, or stop it",
        ) from held
    except OSError as error:
        raise _unwritable(folder, error) from error
    try:
        with _named_holder(folder, now_utc()):
            yield
    finally:
        fcntl.flock(lock, fcntl.LOCK_UN)  # of a process that was forked meanwhile, too
        os.close(lock)


def _locked(path: Path) -> int:
    """Descriptor of a locked file; raises `BlockingIOError` when it is locked, and `OSError`."""
    lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        raise
    return lock


@contextmanager
def _named_holder(folder: Path, since_utc: str) -> Iterator[None]:
    """Leave word for others who holds the lock."""
    note = folder / HOLDER_FILE
    words = {"pid": os.getpid(), "host": socket.gethostname(), "since_utc": since_utc}
    fresh = folder / f"{HOLDER_FILE}.{os.getpid()}"
    try:
        fresh.unlink(missing_ok=True)
        with fresh.open("x", encoding="utf-8") as file:  # through no link to a file elsewhere
            file.write(json.dumps(words))
        fresh.replace(note)
    except OSError as error:
        with suppress(OSError):
            fresh.unlink()
        raise _unwritable(folder, error) from error
    try:
        yield
    finally:
        note.unlink(missing_ok=True)


def lock_holder(folder: Path) -> Holder | None:
    """Process that works on the campaign now; None: nobody does, as far as can be told.

    Takes no lock, so that it is in nobody's way.
    """
    held_by = _noted_holder(folder)
    return None if held_by is None or held_by.is_gone else held_by


def _noted_holder(folder: Path) -> Holder | None:
    """Holder by the note, which may be missing for a moment and outlives a killed process."""
    try:
        words = json.loads(read_bounded(folder / HOLDER_FILE, HOLDER_BYTES))
        return Holder(int(words["pid"]), str(words["host"]), str(words["since_utc"]))
    except (FileRefused, ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None


def _unwritable(folder: Path, error: OSError) -> WriteFailed:
    return WriteFailed(
        f"{folder}: cannot be locked for this process: {error.strerror or error}",
        remedy=REMEDIES.get(error.errno or 0, CHECK_THE_FOLDER),
    )
