"""The journal as an SQLite file: its tables and rules, opened, verified, and errors explained."""

import os
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from campaigns.errors import JournalFailed
from campaigns.journal.digest_chain import (
    EMPTY,
    FROM_BACKUP,
    ChainEnd,
    JournalDamaged,
    Row,
    chain_end,
)
from campaigns.journal.own_file import close_refused

_PRIMARY_CODE = 0xFF
"""SQLite's extended error codes keep their family in the lowest byte."""

_LOCK_PATIENCE_S = 2.0
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
    sqlite3.SQLITE_NOTADB: "name the campaign's own campaign.db, or bring it back from a backup",
    sqlite3.SQLITE_CORRUPT: FROM_BACKUP,
    sqlite3.SQLITE_CONSTRAINT: f"nothing was written; {_AGAIN}",
}


@contextmanager
def sqlite_errors_explained(path: Path, what: str) -> Iterator[None]:
    """Turn any SQLite error inside into `JournalFailed`; `what` says what did not work."""
    try:
        yield
    except sqlite3.Error as error:
        raise JournalFailed(f"{path}: {what}: {error}", remedy=_remedy(error)) from error


def _remedy(error: sqlite3.Error) -> str:
    code: int | None = getattr(
        error, "sqlite_errorcode", None
    )  # absent when Python itself complains
    return _AGAIN if code is None else _REMEDIES.get(code & _PRIMARY_CODE, _AGAIN)


APPLICATION_ID = 0x706B6D63  # "pkmc"
VERSION = 2
CHAINED = 2
"""Version from which records have digests."""

Upgraders = Mapping[int, tuple[str, ...]]
"""Version → the statements that bring a file of that version to the next one."""

# The columns repeat from `body` what the database itself watches over: kind and numbers.
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


# The digests chain the records: chain.py says how. What the last one is stands beside them, so that
# it shows when the last ones are missing. Records of version 1 have none, and come first.
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

UPGRADERS: Upgraders = {1: (_DIGESTS, *_CHAIN)}


def is_blank(connection: sqlite3.Connection) -> bool:
    """Whether nothing was ever stored: a new file, or one whose making was cut short."""
    tables: int = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    return tables == 0 and application_id(connection) == 0 and version(connection) == 0


def application_id(connection: sqlite3.Connection) -> int:
    """Return the mark of the program that made the file."""
    return _pragma(connection, "application_id")


def version(connection: sqlite3.Connection) -> int:
    """Return the version of the file's tables."""
    return _pragma(connection, "user_version")


def create_tables(connection: sqlite3.Connection, rows: Sequence[Row] = ()) -> None:
    """Make a blank file a journal of these records, at once or not at all.

    The rules come last: of version 1 there are records without a digest.
    """
    with in_one_commit(connection):
        connection.execute(_RECORD_TABLE)
        connection.execute(_DIGESTS)
        connection.executemany("INSERT INTO record VALUES (?, ?, ?, ?, ?, ?, ?, ?)", rows)
        for rule in (*_RULES, *_CHAIN):
            connection.execute(rule)
        if rows and rows[-1][-1] is not None:
            last = (rows[-1][0], rows[-1][-1])
            connection.execute("INSERT INTO chain_end VALUES (1, ?, ?)", last)
        connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        connection.execute(_set_version(VERSION))


def upgrade(
    connection: sqlite3.Connection, *, to_version: int = VERSION, upgraders: Upgraders = UPGRADERS
) -> None:
    """Bring an older journal up to `to_version`, each step at once or not at all."""
    for older in range(version(connection), to_version):
        _in_one_commit(connection, (*upgraders[older], _set_version(older + 1)))


def _set_version(number: int) -> str:
    return f"PRAGMA user_version = {number}"


def _pragma(connection: sqlite3.Connection, name: str) -> int:
    value: int = connection.execute(f"PRAGMA {name}").fetchone()[0]
    return value


def _in_one_commit(connection: sqlite3.Connection, statements: tuple[str, ...]) -> None:
    with in_one_commit(connection):
        for statement in statements:
            connection.execute(statement)


@contextmanager
def in_one_commit(connection: sqlite3.Connection) -> Iterator[None]:
    """Commit what is written inside at its end; on any error nothing of it."""
    connection.execute("BEGIN IMMEDIATE")
    with connection:  # commits, or rolls back
        yield


def missing_rules(connection: sqlite3.Connection) -> list[str]:
    """Names of the indexes and triggers that a journal of this version has, and this one lacks."""
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as whole:
        whole.execute(_RECORD_TABLE)
        if version(connection) >= CHAINED:
            whole.execute(_DIGESTS)
        for rule in (*_RULES, *(_CHAIN if version(connection) >= CHAINED else ())):
            whole.execute(rule)
        wanted, found = _names(whole), _names(connection)
    return sorted(wanted - found)


def _names(connection: sqlite3.Connection) -> set[str]:
    rows = connection.execute("SELECT name FROM sqlite_master WHERE sql IS NOT NULL")
    return {name for (name,) in rows}


def stored_records(connection: sqlite3.Connection) -> tuple[list[Row], ChainEnd]:
    """All records as stored, in their order, and the last one that has a digest, of one moment."""
    connection.execute("BEGIN")
    try:
        rows = records_after(connection, 0)
        stated = (
            connection.execute("SELECT record, digest FROM chain_end").fetchone()
            if version(connection) >= CHAINED
            else None
        )
    finally:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
    return rows, EMPTY if stated is None else ChainEnd(*stated)


def records_after(connection: sqlite3.Connection, number: int) -> list[Row]:
    """Records after that number as stored, in their order.

    What is no UTF-8 in them becomes surrogates, which no digest takes.
    """
    digest = "digest" if version(connection) >= CHAINED else "NULL"
    query = (
        f"SELECT id, at_utc, kind, series, shot, attempt, body, {digest} FROM record"  # noqa: S608 - one of two words
        f" WHERE id > {number:d} ORDER BY id"
    )
    try:
        return connection.execute(query).fetchall()
    except sqlite3.OperationalError as error:
        if hasattr(error, "sqlite_errorcode"):  # SQLite's own, not one of decoding
            raise
    connection.text_factory = _text  # which takes longer
    return connection.execute(query).fetchall()


def last_number(connection: sqlite3.Connection) -> int:
    """Return the number of the last record; 0 in an empty journal."""
    number: int = connection.execute("SELECT ifnull(max(id), 0) FROM record").fetchone()[0]
    return number


def verified_records(connection: sqlite3.Connection, path: Path) -> tuple[list[Row], ChainEnd]:
    """All records, and the end of their chain.

    Raises `JournalDamaged` where a record is not what was written, and `JournalFailed` for what
    SQLite cannot read.
    """
    with sqlite_errors_explained(path, "the journal cannot be read"):
        rows, stated = stored_records(connection)
    try:
        return rows, chain_end(rows, stated)
    except JournalDamaged as broken:
        whole = rows[:-1] if broken.number == len(rows) else ()
        problem = f"{path}: {broken.problem}"
        raise JournalDamaged(problem, number=broken.number, whole=whole) from broken


def verify_file(connection: sqlite3.Connection, path: Path) -> None:
    """Raise `JournalDamaged` where SQLite finds its pages, indexes or rules broken."""
    with sqlite_errors_explained(path, "the journal cannot be read"):
        found = [text for (text,) in connection.execute("PRAGMA integrity_check(1)")]
    if found != ["ok"]:
        raise JournalDamaged(f"{path}: the file is damaged: {' '.join(found[0].split())}")


def is_whole(path: Path, end: ChainEnd) -> bool:
    """Whether a journal can be read whole, page by page, and ends with that record."""
    try:
        with closing(connect_to_read(path)) as connection:
            verify_file(connection, path)
            return verified_records(connection, path)[1] == end
    except JournalFailed:
        return False


def connect_to_write(
    path: Path, *, create: bool, waits_for_disk: bool = True
) -> sqlite3.Connection:
    """Open a connection in autocommit mode; the caller closes it. Raises `JournalFailed`.

    Also, before anything is written, for a file whose pages, indexes or rules are broken.
    """
    if not create:
        _check_there(path)
    elif not path.exists():
        make_whole(path)

    def prepare(connection: sqlite3.Connection) -> None:
        blank = create and is_blank(connection)
        if not blank:
            _check_ours(connection, path)
            verify_file(connection, path)
        _make_durable(connection, path, "FULL" if waits_for_disk else "NORMAL")
        if blank:
            create_tables(connection)
        upgrade(connection)

    return _connect(path, "rwc" if create else "rw", prepare)


@contextmanager
def _rights_explained(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        problem = f"{path}: the journal cannot be made: {error.strerror or error}"
        raise JournalFailed(problem, remedy=_RIGHTS) from error


def make_whole(path: Path, rows: Sequence[Row] = ()) -> None:
    """Make a journal of these records; raises `JournalFailed`.

    It is made under another name first: a kill leaves a whole one at the path, or none.
    """
    unfinished = path.with_name(f"{path.name}.new")
    with sqlite_errors_explained(path, "the journal cannot be made"), _rights_explained(path):
        unfinished.unlink(missing_ok=True)
        address = f"{unfinished.resolve().as_uri()}?mode=rwc"
        with closing(sqlite3.connect(address, uri=True, isolation_level=None)) as connection:
            connection.execute("PRAGMA synchronous = FULL")
            create_tables(connection, rows)
        unfinished.replace(path)


def connect_to_read(path: Path) -> sqlite3.Connection:
    """Open a connection that refuses to write; the caller closes it. Raises `JournalFailed`.

    An older file stays as it is: `stored_records` reads every version.
    The file is opened for writing where it can be: only then does SQLite clear its -wal and -shm
    files away at the end. On a medium that cannot be written the bare file is read.
    """
    _check_there(path)

    def prepare(connection: sqlite3.Connection) -> None:
        _check_ours(connection, path)
        connection.execute("PRAGMA query_only = ON")

    if os.access(path.parent, os.W_OK) and os.access(path, os.W_OK):
        return _connect(path, "rw", prepare)
    _check_complete(path)
    return _connect(path, "ro&immutable=1", prepare)


def _connect(
    path: Path, mode: str, prepare: Callable[[sqlite3.Connection], None]
) -> sqlite3.Connection:
    try:
        address = f"{path.resolve().as_uri()}?mode={mode}"
    except (OSError, RuntimeError) as error:  # before Python 3.13 a RuntimeError
        raise JournalFailed(
            f"{path}: leads nowhere ({error})",
            remedy="take the link away, and bring campaign.db back from a backup",
        ) from error
    with sqlite_errors_explained(path, "the journal cannot be opened"):
        connection = sqlite3.connect(
            address, uri=True, isolation_level=None, timeout=_LOCK_PATIENCE_S
        )
        try:
            prepare(connection)
        except BaseException:
            close_refused(connection, path)
            raise
    return connection


def _text(stored: bytes) -> str:
    """Text of a column; what is no UTF-8 becomes surrogates, which no digest takes."""
    return stored.decode("utf-8", errors="surrogateescape")


def _check_there(path: Path) -> None:
    if not path.is_file():
        raise JournalFailed(
            f"{path}: there is no journal", remedy="measure first (`run`), or `import` shots"
        )


def _check_complete(path: Path) -> None:
    remains = path.with_name(f"{path.name}-wal")
    if remains.exists() and remains.stat().st_size:
        raise JournalFailed(
            f"{path}: the latest records are in {remains.name}, and the folder is write-protected",
            remedy="copy the campaign folder to where you may write, and open it there",
        )


def _check_ours(connection: sqlite3.Connection, path: Path) -> None:
    """Comes before anything is written: a file that is not ours is left as it was."""
    found = version(connection)
    if application_id(connection) != APPLICATION_ID or found < 1:
        raise JournalFailed(
            f"{path}: not a journal of pkmcal", remedy="name the campaign's own campaign.db"
        )
    if found > VERSION:
        raise JournalFailed(
            f"{path}: made by a newer pkmcal (version {found}, known here: {VERSION})",
            remedy="install the newer pkmcal; the file was left as it is",
        )


def _make_durable(connection: sqlite3.Connection, path: Path, synchronous: str) -> None:
    mode: str = connection.execute("PRAGMA journal_mode = WAL").fetchone()[0]
    if mode != "wal":
        raise JournalFailed(
            f"{path}: the file system allows no write-ahead log (mode {mode!r})",
            remedy="put the campaign folder on a local disk",
        )
    connection.execute(f"PRAGMA synchronous = {synchronous}")
    connection.execute("PRAGMA fullfsync = ON")  # macOS: fsync alone stops at the drive's cache
