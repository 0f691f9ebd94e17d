"""Lock of a campaign: one process at a time, which says in the locked file who it is."""

import errno
import json
import os
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock, Timeout, lock_descriptor

from campaigns.errors import CampaignLocked, WriteFailed
from drivers.bounded_files import FileRefused, read_bounded

LOCK_FILE = "campaign.lock"
HOLDER_BYTES = 10_000
PATIENCE_S = 0.1
"""Longer than `lock_holder` looks whether the lock is free."""
NO_LOCKS = "this file system has no locks: move the campaign folder to a local disk"
REMEDIES = {
    errno.ENOSYS: NO_LOCKS,
    errno.ENOTSUP: NO_LOCKS,
    errno.ENOLCK: NO_LOCKS,
    errno.ELOOP: f"{LOCK_FILE} is a link: delete it",
    errno.EISDIR: f"{LOCK_FILE} is a folder: delete it",
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


@contextmanager
def campaign_lock(folder: Path, *, now_utc: Callable[[], str]) -> Iterator[None]:
    """Hold the campaign for the time of the block; the system frees it when the process dies.

    Raises `CampaignLocked`, naming the holder, when another process (or another block of this one)
    has it, and `WriteFailed` when the folder cannot be written.
    """
    words = {"pid": os.getpid(), "host": socket.gethostname(), "since_utc": now_utc()}
    held: list[int] = []

    def write_holder(descriptor: int) -> None:
        held.append(descriptor)
        os.ftruncate(descriptor, 0)
        os.write(descriptor, json.dumps(words).encode())

    # a preserved file rules out filelock's softer lock, which a killed process would leave for ever
    lock = FileLock(
        folder / LOCK_FILE,
        timeout=PATIENCE_S,
        poll_interval=PATIENCE_S / 5,
        preserve_lock_file=True,
        on_acquired=write_holder,
    )
    try:
        folder.stat()  # a missing one is not made
        lock.acquire()
    except Timeout as other:
        holder = _noted_holder(folder)
        raise CampaignLocked(
            f"{folder}: another process works on this campaign: "
            f"{holder.says if holder else 'holder unknown'}",
            remedy="wait until it has finished, or stop it",
        ) from other
    except OSError as error:
        raise WriteFailed(
            f"{folder}: cannot be locked for this process: {error.strerror or error}",
            remedy=REMEDIES.get(
                error.errno or 0,
                "check that the folder exists, the right to write it, and the space on the disk",
            ),
        ) from error
    try:
        yield
    finally:
        with suppress(OSError):
            os.ftruncate(held[0], 0)
        lock.release()


def lock_holder(folder: Path) -> Holder | None:
    """Process that works on the campaign now; None: nobody does, as far as can be told.

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
    """Holder by the words in the locked file, which may be missing for a moment."""
    try:
        words = json.loads(read_bounded(folder / LOCK_FILE, HOLDER_BYTES))
        return Holder(int(words["pid"]), str(words["host"]), str(words["since_utc"]))
    except (FileRefused, ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None
