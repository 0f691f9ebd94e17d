"""The journal's tables and rules, its version, and how an older file is brought up to it."""

import sqlite3
from collections.abc import Mapping

APPLICATION_ID = 0x706B6D63  # "pkmc"
VERSION = 1

Upgraders = Mapping[int, tuple[str, ...]]
"""Version → the statements that bring a file of that version to the next one."""

UPGRADERS: Upgraders = {}

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


def create(connection: sqlite3.Connection) -> None:
    """Make a blank file a journal, at once or not at all."""
    _in_one_commit(
        connection,
        (
            _RECORD_TABLE,
            *_RULES,
            f"PRAGMA application_id = {APPLICATION_ID}",
            _set_version(VERSION),
        ),
    )


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
    connection.execute("BEGIN IMMEDIATE")
    with connection:  # commits, or rolls back on any error
        for statement in statements:
            connection.execute(statement)
