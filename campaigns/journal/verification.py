"""Verification of a journal: SQLite's pages and indexes, and the chain of its records."""

import sqlite3
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path

from campaigns.errors import JournalFailed
from campaigns.journal import database
from campaigns.journal.digest_chain import (
    JournalDamaged,
    Problem,
    StoredRecord,
    Verification,
    last_digest,
    verify_chain,
)
from campaigns.journal.journal_files import close_untouched
from campaigns.journal.records import Record
from campaigns.journal.views import Entry, all_series, entry_of


def verify(connection: sqlite3.Connection, path: Path) -> Verification:
    """Read and verify all records; raises `JournalFailed` for what SQLite cannot read at all.

    Behind a broken page nothing is read: what comes before may still verify.
    """
    damage, stored, stated = set[str](), list[StoredRecord](), (0, "")
    with database.snapshot(connection, path):
        damage.add(database.damaged_pages(connection))
        try:
            stored.extend(database.records_after(connection, 0))
            stated = database.stated_end(connection)
        except sqlite3.DatabaseError as error:
            if not database.is_corrupt(error):
                raise
            damage.add(str(error))
    chain = verify_chain(stored, *stated)
    broken = [Problem(f"the file is damaged: {text}") for text in sorted(damage) if text]
    return Verification(chain.records, (*chain.problems, *broken))


def is_whole(path: Path, number: int, digest: str) -> bool:
    """Whether a journal verifies, and ends with the record of that number and digest."""
    try:
        with closing(database.connect_to_read(path)) as connection:
            found = verify(connection, path)
    except JournalFailed:
        return False
    end = len(found.records), last_digest(found.records)
    return not found.problems and end == (number, digest)


def require_whole(
    path: Path, problems: Sequence[Problem], verified: Sequence[StoredRecord] = ()
) -> None:
    """Raise `JournalDamaged` that names the first problem, if there is any."""
    if problems:
        more = f" (and {len(problems) - 1} more)" if problems[1:] else ""
        raise JournalDamaged(f"{path}: {problems[0].problem}{more}", verified)


@dataclass(frozen=True, slots=True, kw_only=True)
class Inspection:
    """Contents of a journal up to the first damage, and everything that is damaged."""

    version: int
    records: int
    """Records that verify."""
    chained: int
    """Stored records that have a digest; version 1 had none."""
    digest: str
    """Digest of the last record that verifies, which stands for all up to it."""
    series: int
    sessions: int
    crashed: int
    shots: int
    """Accepted shots of all series."""
    problems: tuple[Problem, ...]

    @property
    def whole(self) -> bool:
        """Whether nothing is damaged."""
        return not self.problems


def inspect_journal(path: Path) -> Inspection:
    """Verify the journal in a file, which is left as it is, and count what is in it.

    Raises `JournalFailed` for a file that is missing, not ours, newer than this program, or that
    SQLite does not take for one of its own.
    """
    connection, chained = database.connect_to_read(path), 0
    try:
        found = verify(connection, path)
        version = database.version_of(connection)
        with suppress(sqlite3.DatabaseError):  # which is among the problems
            chained = database.chained_records(connection)
    finally:
        close_untouched(connection, path)
    entries, problems = list[Entry[Record]](), list(found.problems)
    for record in found.records:
        try:
            entries.append(entry_of(record))
        except ValueError as error:
            problems.append(Problem(str(error), record.number))
    every = all_series(entries)
    return Inspection(
        version=version,
        records=len(found.records),
        chained=chained,
        digest=last_digest(found.records),
        series=len(every),
        sessions=sum(series.sessions for series in every),
        crashed=sum(series.unstopped for series in every),
        shots=sum(len(series.shots) for series in every),
        problems=tuple(problems),
    )
