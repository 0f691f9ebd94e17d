"""Whole text files: read as UTF-8, written so that a full disk or a crash leaves the old one.

`replace_text` writes in three steps, and their order is what makes them safe:

1. The text goes into a fresh file beside the target, and fsync waits until it is on the disk. A
   full disk shows here, while the old file is untouched.
2. A rename puts the fresh file in the old one's place. The system makes this one step: a reader,
   also after a power cut, has the whole old file or the whole new one. If the rename came before
   the fsync, the name could reach the disk before the text and leave an empty file.
3. An fsync of the folder makes the rename itself last. Without it a power cut could bring the old
   file back after the command has reported success.

A campaign's journal does not come here: SQLite keeps it (`campaigns/journal`).
"""

import contextlib
import errno
import os
from pathlib import Path, PurePath

from campaigns.errors import CampaignError, OutputExists, WriteFailed
from drivers.bounded_files import (
    SAVE_AS_UTF8,
    YAML_BYTES,
    Encoding,
    FileMissing,
    FileRefused,
    decoded,
    is_file,
    read_bounded,
)
from drivers.system import IS_WINDOWS, is_open_elsewhere, problem_on_windows

HEAD_BYTES = 1000
"""Bytes at the beginning of a file that show what it is."""


def read_text(
    path: Path,
    invalid: type[CampaignError],
    *,
    if_missing: str,
    most_bytes: int = YAML_BYTES,
    encoding: Encoding | None = None,
    if_undecoded: str = SAVE_AS_UTF8,
) -> str:
    """Read a file; raise `invalid`, with the remedy `if_missing` when there is no such file.

    A larger file than `most_bytes`, a folder, a pipe or a device is refused before it is read.
    Without a byte-order mark it has the `encoding`, or else UTF-8; `if_undecoded` is the remedy
    for one that has not.
    """
    try:
        return decoded(read_bounded(path, most_bytes), str(path), encoding, if_undecoded)
    except FileMissing as error:
        raise invalid(error.problem, remedy=if_missing) from error
    except FileRefused as error:
        raise invalid(error.problem, remedy=error.remedy) from error


def head_of(path: Path) -> bytes:
    """Return the beginning of a file; empty if it cannot be read."""
    with contextlib.suppress(OSError):
        if is_file(path):
            with path.open("rb") as file:
                return file.read(HEAD_BYTES)
    return b""


def write_new_text(path: Path, text: str) -> None:
    """Write a file that must not exist yet; raise `OutputExists` or `WriteFailed`."""
    refuse_existing(path)
    replace_text(path, text)


def write_text_unless_there(path: Path, text: str, *, overwrite: bool) -> None:
    """Write a file, over an older one only with `overwrite`; raise as `write_new_text` does."""
    refuse_overwriting(path, overwrite=overwrite)
    replace_text(path, text)


def refuse_overwriting(path: Path, *, overwrite: bool) -> None:
    """Raise `OutputExists` for a file that is there, unless it may be overwritten."""
    if not overwrite:
        refuse_existing(path, "replace it with --force, or name another with --to", "--force")


def refuse_existing(
    path: Path, remedy: str = "name another, or move this one away", options: str = ""
) -> None:
    """Raise `OutputExists` when a file, a folder or a link has this name.

    The name is not reserved: inside a campaign its lock keeps a second writer away.
    """
    if os.path.lexists(path):
        raise OutputExists(f"{path} already exists", remedy=remedy, options=options)


def make_folder(path: Path) -> None:
    """Make a folder, and those above it, unless they exist; raise `WriteFailed`."""
    if IS_WINDOWS:
        _refuse_name(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _write_error(path, error) from error


def _refuse_name(path: PurePath) -> None:
    """Raise `WriteFailed` for a path with a name that Windows cannot have, or would change."""
    for name in path.parts[1:] if path.anchor else path.parts:
        if problem := problem_on_windows(name):
            raise WriteFailed(f"{path}: '{name}' {problem}", remedy="choose another name")


def replace_text(path: Path, text: str) -> None:
    """Write a file whole or not at all, over an older one if it exists; raise `WriteFailed`."""
    # A rename onto a link would replace the link, so the file behind it is the target. The fresh
    # file lies in the same folder, because a rename works within one file system only, and carries
    # the process's number, so that two processes do not write into one.
    target = resolved(path)
    fresh = target.with_name(f".{target.name}.{os.getpid()}.new")
    try:
        _write_to_disk(fresh, text)
        fresh.replace(target)
        _sync_folder(target.parent)
    except OSError as error:
        raise _write_error(path, error) from error
    finally:
        with contextlib.suppress(OSError):  # after success there is none
            fresh.unlink()


def resolved(path: Path) -> Path:
    """Return the file or folder that a path leads to; raise `WriteFailed` for a circle of links."""
    try:
        return path.resolve()
    except (OSError, RuntimeError, ValueError) as error:  # before Python 3.13 a RuntimeError
        raise WriteFailed(
            f"{path}: leads nowhere ({error})", remedy="take the link away, or name another"
        ) from error


def _write_to_disk(path: Path, text: str) -> None:
    # "x" makes a new file and writes through no link that somebody has put in its place. What a
    # crash of a process of this number has left is deleted first.
    path.unlink(missing_ok=True)
    with path.open("x", encoding="utf-8", newline="") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())


def _sync_folder(folder: Path) -> None:
    """Make the new name last through a power cut, where the file system can do that."""
    # Shares of Windows and VirtualBox and several file systems in user space cannot (EINVAL,
    # ENOTSUP, ENOSYS, EBADF), and a user may write a folder without reading it (EACCES). The file
    # is complete then, so these errors are passed over; any other one is a fault of the disk.
    try:
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except OSError as error:
        unable = {errno.EINVAL, errno.ENOTSUP, errno.ENOSYS, errno.EBADF, errno.EACCES}
        if error.errno not in unable:
            raise


def _write_error(path: Path, error: OSError) -> WriteFailed:
    if is_open_elsewhere(error):
        remedy = f"close {path.name} in the other program that has it open, then try again"
    elif error.errno in {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}:
        remedy = "free space on the disk, then try again"
    else:
        remedy = "check that the folder exists and that this user may write there"
    reason = (error.strerror or str(error)).lower()
    return WriteFailed(f"{path}: cannot be written ({reason})", remedy=remedy)
