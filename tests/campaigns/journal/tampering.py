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
