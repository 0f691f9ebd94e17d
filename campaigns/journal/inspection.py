"""Inspection of a journal from outside: whether it is whole, what is in it, and what is wrong."""

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from campaigns.errors import JournalFailed
from campaigns.journal import database, views
from campaigns.journal.digest_chain import JournalDamaged, Row
from campaigns.journal.own_file import close_refused
from campaigns.journal.records import Record, from_text
from campaigns.journal.views import Entry


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong, and the record it is about where that is known."""

    problem: str
    record: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Inspection:
    """Contents of a journal, and everything that is wrong with it."""

    version: int
    records: int = 0
    chained: int = 0
    """Records that have a digest; those before them are of an older version."""
    digest: str = ""
    """Of the last record, through which it stands for all of them."""
    series: int = 0
    sessions: int = 0
    crashed: int = 0
    shots: int = 0
    """Accepted shots of all series."""
    problems: tuple[Problem, ...] = ()

    @property
    def whole(self) -> bool:
        """Whether nothing is wrong."""
        return not self.problems


def inspect_journal(path: Path) -> Inspection:
    """Inspection of the journal in a file, which is left as it is.

    Raises `JournalFailed` for a file that is missing, not ours, newer than this program, or that
    SQLite does not take for one of its own.
    """
    connection, found = database.connect_to_read(path), None
    try:
        with database.sqlite_errors_explained(path, "the journal cannot be read"):
            found = _inspection(connection, path)
    finally:
        if found is not None and found.whole:
            connection.close()
        else:
            close_refused(connection, path)
    return found


def _inspection(connection: sqlite3.Connection, path: Path) -> Inspection:
    problems = [*_damage(connection, path)]
    rows, digest = list[Row](), ""
    with suppress(sqlite3.Error):  # which is among the damage
        rows, stated = database.stored_records(connection)
        digest = stated.digest
    entries, unreadable = _entries(rows)
    series = views.all_series(entries)
    return Inspection(
        version=database.version(connection),
        records=len(rows),
        chained=sum(row[-1] is not None for row in rows),
        digest=digest,
        series=len(series),
        sessions=sum(each.sessions for each in series),
        crashed=sum(each.unstopped for each in series),
        shots=sum(len(each.shots) for each in series),
        problems=(*problems, *unreadable),
    )


def _damage(connection: sqlite3.Connection, path: Path) -> Iterator[Problem]:
    """What chain, pages and rules of the file say."""
    for check in (database.verified_records, database.verify_file):
        try:
            check(connection, path)
        except JournalFailed as damaged:
            number = damaged.number if isinstance(damaged, JournalDamaged) else None
            yield Problem(damaged.problem.removeprefix(f"{path}: "), number)
    for rule in database.missing_rules(connection):
        yield Problem(f"the rule '{rule}' has been taken out of the file")


def _entries(rows: Sequence[Row]) -> tuple[list[Entry[Record]], list[Problem]]:
    entries: list[Entry[Record]] = []
    problems: list[Problem] = []
    for number, at_utc, kind, series, _, _, body, _ in rows:
        try:
            entries.append(Entry(number, at_utc, series, from_text(kind, body)))
        except ValueError as error:
            problems.append(Problem(f"record {number} cannot be read: {error}", number))
    return entries, problems


def require_whole(path: Path, found: Inspection) -> None:
    """Raise `JournalDamaged` that names the first problem of a journal that is not whole."""
    if found.whole:
        return
    first, more = found.problems[0], len(found.problems) - 1
    others = f" (and {more} more)" if more else ""
    raise JournalDamaged(f"{path}: {first.problem}{others}", number=first.record)
