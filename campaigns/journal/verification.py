"""Verification of a journal: SQLite's pages and indexes, its rules, and the chain of its records.

SQLite's own integrity check finds pages and indexes that a bad disk or a cut file has broken, but
takes any well-formed row. The chain finds rows that are not what was written: the digest of a
record is the SHA-256 of the record and of the digest before it, so that a changed, renumbered or
missing record shows. Records that are missing at the end would leave a shorter chain that is sound
in itself: therefore the file states number and digest of its last record in a table of its own.

Version 1 stored no digests. Upgrading adds none to its records; they are computed here as if they
had been stored, and the first stored digest that follows covers those records, too.

The rules of the file have to be those that it was made with, and the records such as the rules
take: whatever reads them may rely on that each outcome has its intent, and each series its start.

The chain has no key. It shows accidents and edits, not a forger who computes all digests again; the
digests that exported files and results name show those.
"""

import hashlib
import json
import sqlite3
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from campaigns.errors import JournalFailed
from campaigns.journal import database
from campaigns.journal.database import StoredRecord
from campaigns.journal.journal_files import FROM_BACKUP, close_untouched
from campaigns.journal.records import Record
from campaigns.journal.views import Entry, all_series, entry_of


@dataclass(frozen=True, slots=True)
class Problem:
    """Damage of a journal, and the first record concerned if it is known."""

    problem: str
    record: int | None = None


class JournalDamaged(JournalFailed):
    """Error of a damaged journal; `verified` are the records before the damage."""

    def __init__(self, problem: str, verified: Sequence[StoredRecord] = ()) -> None:
        kept = f"`pkmcal identify DIR` keeps the {len(verified)} records that verify in a copy; or "
        super().__init__(problem, remedy=f"{kept if verified else ''}{FROM_BACKUP}")
        self.verified = verified


@dataclass(frozen=True, slots=True)
class Verification:
    """Records that verify, from the first on, each with its digest; and the damage."""

    records: list[StoredRecord]
    problems: tuple[Problem, ...] = ()
    chained: int = 0
    """Stored records that have a digest; version 1 had none."""


def digest_after(before: str, record: StoredRecord) -> str:
    """Return the SHA-256 (hex) of a record and of the digest of the record before it.

    Raise `TypeError` for a value that is neither text nor number, `ValueError` for text that is not
    Unicode.
    """
    # As a JSON list, in which no value can run into the next one: two records have one text only if
    # all their columns are equal. The last column is the digest itself.
    text = json.dumps([before, *record[:-1]], ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def verify_chain(
    stored: Iterable[StoredRecord],
    stated_number: int,
    stated_digest: str,
    before: Sequence[StoredRecord] = (),
) -> Verification:
    """Verify the chain of stored records, which come in their order.

    `stated_number` and `stated_digest` are those of the last record with a digest, as the file
    states them beside the records; 0 and "" for a file without digests. `before`: records that were
    verified earlier, which these records follow; the result has both.
    """
    # The first record that does not follow the one before ends the chain, for no digest after it
    # can be trusted. The end is compared with the stated one: earlier if records are missing, later
    # (or with another digest) if a program added or changed a record without the triggers.
    records = [*before]
    # Number of the last record with a digest: it covers all before it. What was verified earlier is
    # covered, too, unless the file is of version 1 and still has no digests.
    sealed = len(records) if stated_number else 0
    for record in stored:
        linked = _link(record, records, sealed)
        if isinstance(linked, Problem):
            # Records of version 1 before a wrong digest are cut off, too: any of them may be
            # changed.
            return Verification(records[: (linked.record or 1) - 1], (linked,))
        records.append(linked)
        sealed = record.number if record.digest is not None else sealed
    end, digest = len(records), records[sealed - 1].digest if sealed else ""
    if sealed < stated_number:
        text = f"the records from {end + 1} to {stated_number} are missing"
        return Verification(records, (Problem(text, end + 1),))
    if (sealed, digest) != (stated_number, stated_digest):
        text = f"record {end} is not the last one that was written"
        return Verification(records, (Problem(text, end),))
    return Verification(records)


def _link(
    record: StoredRecord, before: Sequence[StoredRecord], sealed: int
) -> StoredRecord | Problem:
    """Return the record with its digest, or the problem and the first record that it concerns."""
    number, due = record.number, len(before) + 1
    if number != due:
        return Problem(f"record {due} is missing or was renumbered: {number} comes next", due)
    try:
        digest = digest_after(last_digest(before), record)
    except UnicodeEncodeError:
        return Problem(f"record {number} holds text that is no UTF-8", number)
    except TypeError as error:
        return Problem(f"record {number} holds what none may hold: {error}", number)
    if record.digest is None and sealed:
        return Problem(f"record {number} has no digest, though those before it have one", number)
    if record.digest not in (None, digest):
        # The digest covers all records since the last stored one: which of them, it cannot say.
        first = sealed + 1
        which = f"record {number}" if first == number else f"one of the records {first} to {number}"
        return Problem(f"{which} was changed after it was written", first)
    return record if record.digest else record._replace(digest=digest)


def last_digest(records: Sequence[StoredRecord]) -> str:
    """Return the digest of the last verified record, which stands for all; "" without records."""
    return (records[-1].digest or "") if records else ""


def verify(connection: sqlite3.Connection, path: Path) -> Verification:
    """Read and verify all records; raise `JournalFailed` for a file that SQLite cannot read at all.

    Behind a broken page nothing is read; the records before may still verify.
    """
    stored, stated = list[StoredRecord](), (0, "")
    explained = database.sqlite_errors_explained(path, "the journal cannot be read")
    odd = list[str]()
    # In one transaction: records and stated end have to be of one moment, or a run that writes
    # meanwhile looks like damage.
    with explained, database.transaction(connection, "READ"):
        damage = {connection.execute("PRAGMA integrity_check(1)").fetchone()[0]} - {"ok"}
        try:
            odd += database.odd_rules(connection)
            # `extend` keeps the rows that came before SQLite met a broken page.
            stored.extend(database.records_after(connection, 0))
            stated = database.stated_end(connection)
        except sqlite3.DatabaseError as error:
            if database.primary_code(error) == sqlite3.SQLITE_CORRUPT:
                damage.add(str(error))
            elif not odd:  # else a table is missing or has other columns, which `odd` says
                raise
    chain = verify_chain(stored, *stated)
    records, refused = chain.records, database.first_refused(chain.records)
    # Missing rules come first, for they may be the cause of all else; then the chain's problems,
    # which name a record; SQLite's name only a page.
    problems = [_rules_problem(odd)] if odd else []
    if refused is not None:
        number, why = refused
        records = records[: number - 1]
        problems.append(Problem(f"record {number} is none that the journal takes: {why}", number))
    problems += chain.problems
    problems += [
        Problem(f"the file is damaged: {' '.join(text.split())}") for text in sorted(damage)
    ]
    chained = sum(record.digest is not None for record in stored)
    return Verification(records, tuple(problems), chained)


def _rules_problem(odd: Sequence[str]) -> Problem:
    more = f" and {len(odd) - 1} more" if odd[1:] else ""
    return Problem(
        f"of its tables and rules, {odd[0]}{more} are not as they were made: another program has "
        "rebuilt or changed the file"
    )


def has_all(path: Path, number: int, digest: str) -> bool:
    """Return whether a journal verifies, and has the records up to that number and digest."""
    try:
        with closing(database.connect_to_read(path)) as connection:
            verified = verify(connection, path)
    except JournalFailed:
        return False
    return not verified.problems and last_digest(verified.records[:number]) == digest


def require_whole(
    path: Path, problems: Sequence[Problem], verified: Sequence[StoredRecord] = ()
) -> None:
    """Raise `JournalDamaged` that names the first problem, if there is any."""
    if problems:
        more = f" (and {len(problems) - 1} more)" if problems[1:] else ""
        raise JournalDamaged(f"{path}: {problems[0].problem}{more}", verified)


@dataclass(frozen=True, slots=True, kw_only=True)
class Inspection:
    """Contents of a journal up to the first damage, and all damage."""

    path: Path
    whole: bool
    """Whether nothing is damaged."""
    version: int
    records: int
    """Records that verify."""
    chained: int
    """Stored records that have a digest; version 1 had none."""
    digest: str
    """Digest of the last record that verifies, which stands for all up to it."""
    series: int
    sessions: int
    crashed_sessions: int
    shots: int
    """Accepted shots of all series."""
    problems: tuple[Problem, ...]


def inspect_journal(path: Path) -> Inspection:
    """Verify the journal in a file, which is left as it is, and count its contents.

    Raise `JournalFailed` for a file that is missing, not a journal, newer than this program, or not
    a database of SQLite.
    """
    connection = database.connect_to_read(path)
    try:
        verified = verify(connection, path)
        version = database.version_of(connection)
    finally:
        close_untouched(connection, path)
    entries, problems = list[Entry[Record]](), list(verified.problems)
    for record in verified.records:
        try:
            entries.append(entry_of(record))
        except ValueError as error:  # later records may rest on this one
            problems.append(Problem(str(error), record.number))
            break
    series_in_order = all_series(entries)
    return Inspection(
        path=path,
        whole=not problems,
        version=version,
        records=len(verified.records),
        chained=verified.chained,
        digest=last_digest(verified.records),
        series=len(series_in_order),
        sessions=sum(series.sessions for series in series_in_order),
        crashed_sessions=sum(series.unstopped for series in series_in_order),
        shots=sum(len(series.shots) for series in series_in_order),
        problems=tuple(problems),
    )
