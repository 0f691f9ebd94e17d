"""Every write, fsync, rename and the like fails once: the folder stays whole, and work goes on.

As SQLite's own anomaly tests do it. A program of its own, which is started with the library of
`failing_calls.c` in front of libc, and forks: each child does a piece of work in a copy of a folder
while its k-th call fails; the parent then looks at the folder, and does the work again.

    LD_PRELOAD=failing_calls.so python failing_calls.py SCRATCH STRIDE WORK...

prints a line for each fault that was not survived, and at the end how many were tried.
"""

import ctypes
import errno
import os
import shutil
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import NamedTuple

from journal_story import SESSION, beginning, intent, outcome, ticking

from campaigns.campaign import JOURNAL
from campaigns.errors import CampaignError
from campaigns.files.lock import campaign_lock
from campaigns.files.text_file import replace_text
from campaigns.journal.journal import open_journal, read_journal
from campaigns.journal.journal_files import rescued_copies

DATA = Path(__file__).parents[1] / "data"
SOURCE = Path(__file__).with_suffix(".c")
REFUSED, CRASHED = 4, 70


class Fault(NamedTuple):
    """How a call fails; `torn` writes half before, `for_good` lets all later calls fail, too."""

    error: int
    torn: bool
    for_good: bool


FAULTS = (
    Fault(errno.ENOSPC, torn=False, for_good=False),
    Fault(errno.EIO, torn=True, for_good=False),
    Fault(errno.EIO, torn=True, for_good=True),
)
Said = Callable[[int], None]
"""Receives how many records are durable."""


class Work(NamedTuple):
    """What is done in a folder, how the folder is made, and what may be wrong with it then."""

    make: Callable[[Path], object]
    do: Callable[[Path, Said], object]


def with_journal(folder: Path, version: int = 2) -> None:
    shutil.copy(DATA / f"journal-v{version}.db", folder / JOURNAL)


def write_records(folder: Path, said: Said) -> None:
    """Begin a series, write single records and an import, and prove the file."""
    with open_journal(folder / JOURNAL, now_utc=ticking()) as journal:
        series = journal.start_series(beginning())
        said(journal.last_number())
        for record in (SESSION, intent(1), outcome(1)):
            said(journal.append(record, series=series))
        with journal.in_one_commit():
            for shot in range(2, 6):
                journal.append(intent(shot), series=series)
                journal.append(outcome(shot), series=series)
        said(journal.last_number())
        journal.prove()


def write_text(folder: Path, _: Said) -> None:
    """Replace a text, held by the campaign's lock."""
    with campaign_lock(folder, now_utc=ticking()):
        replace_text(folder / TEXT, NEW)


TEXT, OLD, NEW = "text.yaml", "old: 1\n" * 3000, "new: 2\n" * 4000
WORKS = {
    "new journal": Work(lambda _: None, write_records),
    "journal": Work(with_journal, write_records),
    "journal of version 1": Work(lambda folder: with_journal(folder, 1), write_records),
    "text": Work(lambda folder: (folder / TEXT).write_text(OLD), write_text),
    "new text": Work(lambda _: None, write_text),
}


def main(scratch: Path, stride: int, names: list[str]) -> int:
    """Try all faults of these works; return how many were not survived."""
    library, tried, bad = ctypes.CDLL(os.environ["LD_PRELOAD"]), 0, 0
    for name in names:
        for fault in FAULTS:
            for k in count(1, stride):
                folder = scratch / "below"
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                WORKS[name].make(folder)
                before = numbers(folder)
                durable, code, was_met = in_a_child(library, WORKS[name], folder, k, fault)
                tried += 1
                unlike = [] if code in {0, REFUSED} else ["ended without an error of its own"]
                after = problems(WORKS[name], folder, before, durable, fault)
                for problem in (*unlike, *after):
                    bad += 1
                    sys.stdout.write(f"{name}, call {k}, {fault}, code {code}: {problem}\n")
                if not was_met:
                    break
    sys.stdout.write(f"{tried} faults, {bad} not survived\n")
    return bad


def in_a_child(
    library: ctypes.CDLL, work: Work, folder: Path, k: int, fault: Fault
) -> tuple[int, int, bool]:
    """Return the records that were durable, how the child ended, and whether the fault was met."""
    read_end, write_end = os.pipe()
    child = os.fork()
    if child == 0:
        code = CRASHED
        try:
            os.close(read_end)
            below = str(folder).encode()
            library.fail_call(k, below, fault.error, fault.torn, fault.for_good)
            try:
                work.do(folder, lambda number: os.write(write_end, b"%d\n" % number))
                code = 0
            except CampaignError:
                code = REFUSED
            made = library.calls_made()
            os.write(write_end, b"met\n" if made >= k else b"not met\n")
        except BaseException:  # noqa: BLE001 - the parent sees it by the code
            traceback.print_exc()
        finally:
            os._exit(code)
    os.close(write_end)
    with os.fdopen(read_end) as said:
        *durable, met = [*said.read().split("\n")[:-1]] or ["met"]
    _, status = os.waitpid(child, 0)
    return int(durable[-1]) if durable else 0, os.waitstatus_to_exitcode(status), met == "met"


def numbers(folder: Path) -> tuple[object, ...]:
    """Return the records of a folder's journal; () without one."""
    if not (folder / JOURNAL).exists():
        return ()
    with read_journal(folder / JOURNAL) as journal:
        return journal.records()


def problems(
    work: Work, folder: Path, before: tuple[object, ...], durable: int, fault: Fault
) -> Iterator[str]:
    """Yield what is wrong with a folder after a fault, and with the same work done again."""
    try:
        records = numbers(folder)
        yield from losses(folder, records, before, durable)
        work.do(folder, lambda _: None)
        if numbers(folder)[: len(records)] != records:
            yield "records were lost by the work that went on"
    except CampaignError as error:
        yield f"the work cannot go on: {error}"
    text = folder / TEXT
    if text.exists() and text.read_text() != NEW:
        yield "the text is the old one"
    litter = [each.name for each in folder.iterdir() if each.suffix == ".new"]
    if litter and not fault.for_good:  # else nothing could be put away
        yield f"litter: {litter}"


def losses(
    folder: Path, records: tuple[object, ...], before: tuple[object, ...], durable: int
) -> Iterator[str]:
    """Yield what a folder has lost of its records before, or of its text."""
    if records[: len(before)] != before:
        yield "records were lost"
    if len(records) < durable:
        yield f"{durable} records were durable, {len(records)} are there"
    for copy in rescued_copies(folder / JOURNAL):
        with read_journal(copy) as rescued:
            if rescued.records() != records[: rescued.last_number()]:
                yield "a copy has what the journal has not"
    text = folder / TEXT
    if text.exists() and text.read_text() not in {OLD, NEW}:
        yield "the text is half written"


def is_possible() -> bool:
    """Return whether such a library can be made and loaded here."""
    return sys.platform == "linux" and shutil.which("cc") is not None


def try_faults(scratch: Path, stride: int, names: list[str]) -> str:
    """Make the library and try the faults in a process of its own; return what it printed."""
    library = scratch / "failing_calls.so"
    make = ["cc", "-shared", "-fPIC", "-O1", "-w", "-o", library, SOURCE, "-ldl"]
    subprocess.run(make, check=True)
    here = Path(__file__)
    path = os.pathsep.join([str(here.parent), str(here.parents[2])])
    program = [sys.executable, here, scratch, str(stride), *names]
    environment = {**os.environ, "LD_PRELOAD": str(library), "PYTHONPATH": path}
    ended = subprocess.run(
        program, env=environment, capture_output=True, text=True, check=False, timeout=3000
    )
    return ended.stdout + ended.stderr


if __name__ == "__main__":
    sys.exit(min(main(Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3:]), 100))
