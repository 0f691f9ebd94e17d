"""Journal as an SQLite file: its tables and rules, opened, read, written, and errors explained.

One table holds all records, one row a record, and only grows. The rules are in the file itself, as
CHECKs, unique indexes and triggers, so that another program (a viewer, a script, an older version)
cannot break them by accident. They refuse to change, remove or replace a record, to use a number
twice, to end an attempt that was never begun or has ended, and to write into a series that has not
begun. Programs that rebuild tables drop the rules without a word: `odd_rules` finds that out at
each opening, and `first_refused` plays the records through the rules once more.

Every write goes into SQLite's write-ahead log (WAL) and, with `synchronous = FULL`, is on the disk
when the commit returns: a kill or a power cut leaves all records up to the last one that was
committed. Reading never blocks writing, so that `status` and `report` look at a run while it
measures.

Version 1 had no digests. It is read as it is, and upgraded when it is opened to write.
"""

import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Literal, NamedTuple

from campaigns.errors import JournalFailed
from campaigns.files.lock import NO_LOCKS, has_record_locks
from campaigns.journal.journal_files import FROM_BACKUP, close_untouched, log_of

APPLICATION_ID = 0x706B6D63  # "pkmc"
VERSION = 2
CHAINED_SINCE = 2
"""Version from which records have digests."""
LOCK_TIMEOUT_S = 2.0
"""Longest wait for another program's transaction."""
_AGAIN = "start the command again, and report this if it comes back"
_RIGHTS = "give this user the right to write the campaign folder and its files"
_OTHER_PROGRAM = "close the other program that has the journal open, then start again: it resumes"
_REMEDIES: Mapping[int, str] = {
    sqlite3.SQLITE_FULL: "free space on the disk, then start the command again: it resumes",
    sqlite3.SQLITE_IOERR: "check the disk and the space left on it, then start again: it resumes",
    sqlite3.SQLITE_BUSY: _OTHER_PROGRAM,
    sqlite3.SQLITE_LOCKED: _OTHER_PROGRAM,
    sqlite3.SQLITE_READONLY: _RIGHTS,
    sqlite3.SQLITE_PERM: _RIGHTS,
    sqlite3.SQLITE_CANTOPEN: "check that the folder exists and that this user may write it",
    sqlite3.SQLITE_NOTADB: FROM_BACKUP,
    sqlite3.SQLITE_CORRUPT: FROM_BACKUP,
    sqlite3.SQLITE_CONSTRAINT: f"nothing was written; {_AGAIN}",
}


class StoredRecord(NamedTuple):
    """Record as a row of the table; `digest` is None in a record of version 1."""

    number: int
    at_utc: str
    kind: str
    series: int | None
    shot: int | None
    attempt: int | None
    body: str
    digest: str | None


@contextmanager
def sqlite_errors_explained(path: Path, what: str) -> Iterator[None]:
    """Turn any error of SQLite or the system inside into `JournalFailed`.

    `what` is a clause that names the step, such as "the journal cannot be opened".
    """
    try:
        yield
    except sqlite3.Error as error:
        remedy = _REMEDIES.get(primary_code(error), _AGAIN)
        if remedy == _OTHER_PROGRAM and not has_record_locks(path.with_name("campaign.yaml")):
            remedy = NO_LOCKS  # SQLite reports a file system without locks as a locked database
        raise JournalFailed(f"{path}: {what}: {error}", remedy=remedy) from error
    except OSError as error:
        raise JournalFailed(f"{path}: {what}: {error.strerror or error}", remedy=_RIGHTS) from error


def primary_code(error: sqlite3.Error) -> int:
    """Return the family of SQLite's extended code; 0 for an error that Python itself raised."""
    # The lowest byte of an extended code is the primary one, by which the remedies are listed.
    return getattr(error, "sqlite_errorcode", 0) & 0xFF


# The columns repeat from `body` what the rules below compare: kind and numbers.
# `typeof` in the CHECKs, because a column's type binds no value in SQLite: text that is no number
# stays text in an INTEGER column, and a digest of it would verify.
# No STRICT table and no JSON functions: some supported systems come with an older SQLite.
_RECORD_TABLE = """
CREATE TABLE record (
    id      INTEGER PRIMARY KEY CHECK (id > 0),
    at_utc  TEXT NOT NULL CHECK (typeof(at_utc) = 'text'),
    kind    TEXT NOT NULL CHECK (kind IN ('series-started', 'series-finished', 'session-started',
        'session-stopped', 'intent', 'outcome', 'rejected', 'pair-voided', 'event', 'finding')),
    series  INTEGER CHECK (typeof(series) = 'integer'
        OR (series IS NULL AND kind IN ('event', 'finding'))),
    shot    INTEGER CHECK (typeof(shot) = CASE
        WHEN kind IN ('intent', 'outcome', 'rejected') THEN 'integer' ELSE 'null' END),
    attempt INTEGER CHECK (typeof(attempt) = CASE
        WHEN kind IN ('intent', 'outcome', 'rejected') THEN 'integer' ELSE 'null' END),
    body    TEXT NOT NULL CHECK (typeof(body) = 'text')
)"""

# The unique indexes alone would not do: INSERT OR REPLACE removes the older row to make room, and
# fires no DELETE trigger. So a BEFORE INSERT trigger refuses a taken number first.
_RULES = (
    "CREATE UNIQUE INDEX one_series ON record (series) WHERE kind = 'series-started'",
    "CREATE UNIQUE INDEX one_finish ON record (series) WHERE kind = 'series-finished'",
    "CREATE UNIQUE INDEX one_intent ON record (series, shot, attempt) WHERE kind = 'intent'",
    """
CREATE UNIQUE INDEX one_end ON record (series, shot, attempt)
WHERE kind IN ('outcome', 'rejected')""",
    """
CREATE TRIGGER a_record_is_never_changed BEFORE UPDATE ON record
BEGIN SELECT RAISE(ABORT, 'the journal is append-only: a record is never changed'); END""",
    """
CREATE TRIGGER a_record_is_never_removed BEFORE DELETE ON record
BEGIN SELECT RAISE(ABORT, 'the journal is append-only: a record is never removed'); END""",
    """
CREATE TRIGGER a_record_is_never_replaced BEFORE INSERT ON record
WHEN EXISTS (SELECT 1 FROM record WHERE id = NEW.id)
BEGIN SELECT RAISE(ABORT, 'the journal is append-only: a record is never replaced'); END""",
    """
CREATE TRIGGER a_record_comes_last AFTER INSERT ON record
WHEN NEW.id < (SELECT max(id) FROM record)
BEGIN SELECT RAISE(ABORT, 'the journal is append-only: a record comes after all others'); END""",
    """
CREATE TRIGGER a_series_begins_and_finishes_once BEFORE INSERT ON record
WHEN NEW.kind IN ('series-started', 'series-finished') AND EXISTS (
    SELECT 1 FROM record WHERE series = NEW.series AND kind = NEW.kind)
BEGIN SELECT RAISE(ABORT, 'a series begins once and finishes once'); END""",
    """
CREATE TRIGGER a_record_is_of_a_series_that_began BEFORE INSERT ON record
WHEN NEW.series IS NOT NULL AND NEW.kind <> 'series-started' AND NOT EXISTS (
    SELECT 1 FROM record WHERE series = NEW.series AND kind = 'series-started')
BEGIN SELECT RAISE(ABORT, 'no such series has begun'); END""",
    """
CREATE TRIGGER an_intent_has_a_new_number BEFORE INSERT ON record
WHEN NEW.kind = 'intent' AND EXISTS (
    SELECT 1 FROM record WHERE kind = 'intent'
    AND series = NEW.series AND shot = NEW.shot AND attempt = NEW.attempt)
BEGIN SELECT RAISE(ABORT, 'numbers are never reused: this attempt was intended already'); END""",
    """
CREATE TRIGGER an_outcome_has_its_intent BEFORE INSERT ON record
WHEN NEW.kind IN ('outcome', 'rejected') AND NOT EXISTS (
    SELECT 1 FROM record WHERE kind = 'intent'
    AND series = NEW.series AND shot = NEW.shot AND attempt = NEW.attempt)
BEGIN SELECT RAISE(ABORT, 'this attempt was never intended'); END""",
    """
CREATE TRIGGER an_attempt_ends_once BEFORE INSERT ON record
WHEN NEW.kind IN ('outcome', 'rejected') AND EXISTS (
    SELECT 1 FROM record WHERE kind IN ('outcome', 'rejected')
    AND series = NEW.series AND shot = NEW.shot AND attempt = NEW.attempt)
BEGIN SELECT RAISE(ABORT, 'numbers are never reused: this attempt has its outcome already'); END""",
)


# `chain_end` shows when the last records are missing. Records of version 1 have no digest, so the
# column may be NULL, and a trigger demands a digest of new records. `chain_end` follows each record
# by a trigger, in the record's own transaction: the two never disagree after a crash.
_DIGESTS = "ALTER TABLE record ADD COLUMN digest TEXT"
_CHAIN = (
    """
CREATE TABLE chain_end (
    one    INTEGER PRIMARY KEY CHECK (one = 1),
    record INTEGER NOT NULL,
    digest TEXT NOT NULL
)""",
    """
CREATE TRIGGER a_record_has_its_digest BEFORE INSERT ON record
WHEN typeof(NEW.digest) <> 'text'
BEGIN SELECT RAISE(ABORT, 'a record is chained to the one before by its digest'); END""",
    """
CREATE TRIGGER the_chain_ends_with_the_last_record AFTER INSERT ON record
BEGIN INSERT OR REPLACE INTO chain_end VALUES (1, NEW.id, NEW.digest); END""",
    """
CREATE TRIGGER the_end_of_the_chain_is_never_removed BEFORE DELETE ON chain_end
BEGIN SELECT RAISE(ABORT, 'the journal is append-only: the chain keeps its end'); END""",
)


def create_journal(path: Path, records: Sequence[StoredRecord] = ()) -> None:
    """Make a journal of these records; raise `JournalFailed`.

    The file is made under another name first: a kill leaves a whole journal at the path, or none.
    """
    # In rollback mode and synced, then renamed: the rename is atomic, and there is no log of the
    # old name yet that would have to follow. The log is turned on when the journal is opened to
    # write.
    unfinished = path.with_name(f"{path.name}.new")
    with sqlite_errors_explained(path, "the journal cannot be made"):
        unfinished.unlink(missing_ok=True)
        try:
            with closing(sqlite3.connect(unfinished, isolation_level=None)) as connection:
                connection.execute("PRAGMA synchronous = FULL")
                _create_tables(connection, records)
            unfinished.replace(path)
        finally:
            with suppress(OSError):  # after success it has been renamed
                unfinished.unlink()


def _create_tables(connection: sqlite3.Connection, records: Sequence[StoredRecord]) -> None:
    """Write tables, records and rules in one transaction.

    The rules come last: they would refuse rescued records of version 1, which have no digests.
    """
    with transaction(connection, "WRITE"):
        connection.execute(_RECORD_TABLE)
        connection.execute(_DIGESTS)
        connection.executemany("INSERT INTO record VALUES (?, ?, ?, ?, ?, ?, ?, ?)", records)
        for rule in (*_RULES, *_CHAIN):
            connection.execute(rule)
        if records:
            last = (records[-1].number, records[-1].digest)
            connection.execute("INSERT INTO chain_end VALUES (1, ?, ?)", last)
        connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        connection.execute(f"PRAGMA user_version = {VERSION}")


def connect_to_write(path: Path) -> sqlite3.Connection:
    """Open a connection in autocommit mode, to a new journal if there is none at the path.

    An existing journal is not changed yet; the caller closes the connection. Raise `JournalFailed`.
    """
    # Mode "rw" below, not "rwc": SQLite itself never makes a file, which would be an empty one.
    if not path.exists():
        create_journal(path)
    return _connect(path, "rw")


def connect_to_read(path: Path) -> sqlite3.Connection:
    """Open a connection that refuses to write; the caller closes it. Raise `JournalFailed`.

    The file is opened for writing where it can be: only then does SQLite clear its -wal and -shm
    files away at the end. On a medium that cannot be written the bare file is read.
    """
    # `immutable` skips the log and the locks, neither of which SQLite can make there. The records
    # in a log would be passed over in silence, so a log that holds any is refused first.
    if not path.is_file():
        raise JournalFailed(
            f"{path}: there is no journal", remedy="measure first (`run`), or `import` shots"
        )
    if os.access(path.parent, os.W_OK) and os.access(path, os.W_OK):
        connection = _connect(path, "rw")
    else:
        _require_empty_log(path)
        connection = _connect(path, "ro&immutable=1")
    connection.execute("PRAGMA query_only = ON")
    return connection


def _connect(path: Path, mode: str) -> sqlite3.Connection:
    """Open a file; refuse one that is not a journal or is newer, and leave it as it was."""
    with sqlite_errors_explained(path, "the journal cannot be opened"):
        connection = sqlite3.connect(
            f"{path.resolve().as_uri()}?mode={mode}",
            uri=True,
            isolation_level=None,  # autocommit: Python would begin transactions of its own
            timeout=LOCK_TIMEOUT_S,
        )
        # Bytes that are not UTF-8 become surrogates, which `digest_after` refuses: the record is
        # reported as damaged, where Python's default decoder would end the reading of all.
        connection.text_factory = lambda text: text.decode("utf-8", errors="surrogateescape")
        try:
            _require_ours(connection, path)
        except BaseException:
            close_untouched(connection, path)
            raise
    return connection


def _require_ours(connection: sqlite3.Connection, path: Path) -> None:
    # Before anything is written: a wrong file name must not turn another program's database into a
    # journal, and this program would misread a newer version's records.
    version = version_of(connection)
    if _pragma(connection, "application_id") != APPLICATION_ID or version < 1:
        raise JournalFailed(f"{path}: not a journal of pkmcal", remedy=FROM_BACKUP)
    if version > VERSION:
        raise JournalFailed(
            f"{path}: made by a newer pkmcal (version {version}, known here: {VERSION})",
            remedy="install the newer pkmcal; the file was left as it is",
        )


def _require_empty_log(path: Path) -> None:
    log = log_of(path)
    if log.exists() and log.stat().st_size:
        raise JournalFailed(
            f"{path}: the latest records are in {log.name}, and the folder is write-protected",
            remedy="copy the campaign folder to where you may write, and open it there",
        )


def prepare_to_write(connection: sqlite3.Connection, path: Path, *, waits_for_disk: bool) -> None:
    """Turn the write-ahead log on, and upgrade an older journal to this version."""
    with sqlite_errors_explained(path, "the journal cannot be opened"):
        mode: str = connection.execute("PRAGMA journal_mode = WAL").fetchone()[0]
        # A file system without shared memory (a network drive) keeps the old mode without an error.
        if mode != "wal":
            raise JournalFailed(
                f"{path}: the file system allows no write-ahead log (mode {mode!r})",
                remedy="put the campaign folder on a local disk",
            )
        # FULL syncs the log at each commit. NORMAL syncs it only when it is moved into the
        # database: a kill loses nothing, a power cut may. That is enough where the cell is
        # simulated, for there no robot has moved.
        connection.execute(f"PRAGMA synchronous = {'FULL' if waits_for_disk else 'NORMAL'}")
        connection.execute("PRAGMA fullfsync = ON")  # macOS: fsync alone stops at the drive's cache
        if version_of(connection) < CHAINED_SINCE:
            # In one transaction: a kill leaves a whole file of one version or the other.
            with transaction(connection, "WRITE"):
                for statement in (_DIGESTS, *_CHAIN, f"PRAGMA user_version = {VERSION}"):
                    connection.execute(statement)


def version_of(connection: sqlite3.Connection) -> int:
    """Return the version of the file's tables."""
    return _pragma(connection, "user_version")


def _pragma(connection: sqlite3.Connection, name: str) -> int:
    value: int = connection.execute(f"PRAGMA {name}").fetchone()[0]
    return value


@contextmanager
def transaction(connection: sqlite3.Connection, kind: Literal["READ", "WRITE"]) -> Iterator[None]:
    """Read inside from one moment, or commit all that is written inside; on any error nothing."""
    # IMMEDIATE takes the lock for writing at once. A transaction that reads first and writes later
    # can fail in the middle, when another program has written in between.
    connection.execute("BEGIN IMMEDIATE" if kind == "WRITE" else "BEGIN")
    with connection:  # commits, or rolls back
        yield


def odd_rules(connection: sqlite3.Connection) -> list[str]:
    """Return the names of tables, indexes and triggers that are not as its version was made.

    They are missing, were changed, or are triggers of somebody else. Further tables, views and
    indexes, such as viewers make, are none of ours and change no record.
    """
    is_chained = version_of(connection) >= CHAINED_SINCE
    with closing(sqlite3.connect(":memory:")) as model:
        for statement in (_RECORD_TABLE, *_RULES, *((_DIGESTS, *_CHAIN) if is_chained else ())):
            model.execute(statement)
        wanted = _schema(model)
    present = _schema(connection)
    foreign = [name for kind, name in present if kind == "trigger" and (kind, name) not in wanted]
    return [key[1] for key, sql in wanted.items() if present.get(key) != sql] + foreign


def _schema(connection: sqlite3.Connection) -> dict[tuple[str, str], str]:
    """Return the statements that made a database, by kind and name; spaces do not count."""
    query = "SELECT type, name, sql FROM sqlite_master WHERE sql IS NOT NULL"
    return {(kind, name): " ".join(sql.split()) for kind, name, sql in connection.execute(query)}


def first_refused(records: Iterable[StoredRecord]) -> tuple[int, str] | None:
    """Return the number of the first record that the rules refuse, and why; None: they take all.

    A forger computes the digests again and puts the rules back; these records never passed them.
    """
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as replay:
        for statement in (_RECORD_TABLE, _DIGESTS, *_RULES, "BEGIN"):
            replay.execute(statement)
        for record in records:
            try:
                insert(replay, record)
            except sqlite3.Error as error:
                return record.number, str(error)
    return None


def stated_end(connection: sqlite3.Connection) -> tuple[int, str]:
    """Return number and digest of the last record with a digest, as the file states them.

    0 and "" if no record has a digest.
    """
    if version_of(connection) < CHAINED_SINCE:
        return 0, ""
    return connection.execute("SELECT record, digest FROM chain_end").fetchone() or (0, "")


def records_after(connection: sqlite3.Connection, number: int) -> Iterator[StoredRecord]:
    """Read the records after a number, in their order."""
    digest = "digest" if version_of(connection) >= CHAINED_SINCE else "NULL"
    query = (
        f"SELECT id, at_utc, kind, series, shot, attempt, body, {digest} FROM record"  # noqa: S608 - one of two words
        f" WHERE id > {number:d} ORDER BY id"
    )
    return map(StoredRecord._make, connection.execute(query))


def insert(connection: sqlite3.Connection, record: StoredRecord) -> None:
    """Write a record."""
    # No RETURNING here: with it the commit waits until the row has been fetched to the end.
    connection.execute("INSERT INTO record VALUES (?, ?, ?, ?, ?, ?, ?, ?)", record)
