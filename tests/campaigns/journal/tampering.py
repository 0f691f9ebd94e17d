"""A journal changed by hand, by somebody who knows SQLite: its rules are put aside first."""

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from campaigns.journal.database import StoredRecord, records_after
from campaigns.journal.verification import digest_after


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


def forge(path: Path, *statements: str) -> None:
    """Run statements on the file, and compute all digests again, so that its chain is sound."""
    tamper(path, "PRAGMA ignore_check_constraints = ON", *statements)
    with closing(sqlite3.connect(path)) as connection:
        records, before = [*records_after(connection, 0)], ""
    chain = []
    for record in records:
        before = digest_after(before, record)
        chain.append(f"UPDATE record SET digest = '{before}' WHERE id = {record.number}")
    end = f"INSERT OR REPLACE INTO chain_end VALUES (1, {records[-1].number}, '{before}')"
    tamper(path, *chain, end)


def add_by_hand(path: Path, kind: str, body: str) -> None:
    """Write one more record, of no shot, that follows the chain, as another program might."""
    with closing(sqlite3.connect(path)) as other, other:
        number, digest = other.execute("SELECT record, digest FROM chain_end").fetchone()
        record = StoredRecord(number + 1, "", kind, 1, None, None, body, None)
        record = record._replace(digest=digest_after(digest, record))
        other.execute("INSERT INTO record VALUES (?, ?, ?, ?, ?, ?, ?, ?)", record)
