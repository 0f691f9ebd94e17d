"""Verification of a journal as stored: text, numbers and the chain of digests."""

import sqlite3
from pathlib import Path

from campaigns.errors import JournalFailed
from campaigns.journal.chain import ChainBroken, ChainEnd, chain_end
from campaigns.journal.database import (
    FROM_BACKUP,
    sqlite_errors_explained,
    stored_records,
    undecodable_record,
)


class JournalDamaged(JournalFailed):
    """A journal that is not what was written; `number` is the first record concerned, if known."""

    def __init__(self, problem: str, *, remedy: str = FROM_BACKUP, number: int | None = None):
        super().__init__(problem, remedy=remedy)
        self.number = number


def verified_end(connection: sqlite3.Connection, path: Path) -> ChainEnd:
    """End of the journal's chain; raises `JournalDamaged` where a record is not what was written.

    Raises `JournalFailed` for what SQLite cannot read.
    """
    with sqlite_errors_explained(path, "the journal cannot be read"):
        try:
            rows, stated = stored_records(connection)
        except sqlite3.OperationalError:
            number = undecodable_record(connection)
            if number is None:
                raise
            problem = f"{path}: record {number} holds text that is no UTF-8"
            raise JournalDamaged(problem, number=number) from None
    try:
        return chain_end(rows, stated)
    except ChainBroken as broken:
        raise JournalDamaged(f"{path}: {broken}", number=broken.number) from broken


def verify_file(connection: sqlite3.Connection, path: Path) -> None:
    """Raise `JournalDamaged` where SQLite finds its pages, indexes or rules broken."""
    with sqlite_errors_explained(path, "the journal cannot be read"):
        found = [text for (text,) in connection.execute("PRAGMA integrity_check(1)")]
    if found != ["ok"]:
        raise JournalDamaged(f"{path}: the file is damaged: {' '.join(found[0].split())}")
