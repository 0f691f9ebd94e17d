"""A journal changed by hand, by somebody who knows SQLite: its rules are put aside first."""

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path


def tamper(path: Path, *statements: str, values: Sequence[object] = ()) -> None:
    """Run statements on the file without its triggers, which are there again afterwards."""
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        rules = connection.execute(
            "SELECT name, sql FROM sqlite_master WHERE type = 'trigger'"
        ).fetchall()
        for name, _ in rules:
            connection.execute(f"DROP TRIGGER {name}")
        for statement in statements:
            connection.execute(statement, values)
        for _, sql in rules:
            connection.execute(sql)


def change_text(path: Path, number: int, old: str, new: str) -> None:
    """Put other characters into the body of a record."""
    tamper(path, f"UPDATE record SET body = replace(body, '{old}', '{new}') WHERE id = {number}")


def make_version_1(path: Path) -> None:
    """Take away what version 2 added: the journal as older software left it."""
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        for trigger in (
            "a_record_has_its_digest",
            "the_chain_ends_with_the_last_record",
            "the_end_of_the_chain_is_never_removed",
        ):
            connection.execute(f"DROP TRIGGER {trigger}")
        connection.execute("DROP TABLE chain_end")
        connection.execute("ALTER TABLE record DROP COLUMN digest")
        connection.execute("PRAGMA user_version = 1")
