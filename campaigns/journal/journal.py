"""Writes a campaign's journal: a record is durable before `append` returns, and never changes."""

from collections.abc import Callable
from pathlib import Path
from sqlite3 import Connection

from campaigns.errors import JournalFailed
from campaigns.journal.connection import connect_to_write
from campaigns.journal.faults import explained
from campaigns.journal.reader import JournalReader
from campaigns.journal.record_text import KIND_OF_TYPE, to_text
from campaigns.journal.records import (
    Intent,
    Outcome,
    Record,
    Rejected,
    SeriesStarted,
    SessionStarted,
)
from campaigns.journal.views import Entry


def open_journal(path: Path, *, now_utc: Callable[[], str], create: bool = False) -> "Journal":
    """Open the journal in that file; `create` makes one where there is none.

    `now_utc` stamps the records. The caller holds the campaign's lock. Raises `JournalFailed` when
    the file is missing, not ours, newer than this program, or cannot be opened.
    """
    return Journal(connect_to_write(path, create=create), path, now_utc)


class Journal(JournalReader):
    """A journal that grows. Once a record could not be written, no further one is."""

    def __init__(self, connection: Connection, path: Path, now_utc: Callable[[], str]) -> None:
        super().__init__(connection, path)
        self._now_utc = now_utc
        self._own_sessions: set[int] = set()
        self._failed = False

    def start_series(self, started: SeriesStarted) -> int:
        """Begin a new series and return its number."""
        series = self._highest("SELECT max(series) FROM record") + 1
        self.append(started, series=series)
        return series

    def append(self, record: Record, *, series: int | None = None) -> int:
        """Write one record, durable on return, and return its place in the journal.

        Only an `Event` or a `Finding` may do without a series. Raises `JournalFailed`.
        """
        if self._failed:
            raise JournalFailed(
                f"{self._path}: a record could not be written before, so none is written any more",
                remedy="see the first error; start the command again, it resumes",
            )
        try:
            place = self._insert(record, series)
        except JournalFailed:
            self._failed = True
            raise
        if isinstance(record, SessionStarted):
            self._own_sessions.add(place)
        return place

    def crashed_sessions(self) -> tuple[Entry[SessionStarted], ...]:
        """Return the sessions that never stopped, but for those begun here."""
        return tuple(
            entry for entry in super().crashed_sessions() if entry.number not in self._own_sessions
        )

    def _insert(self, record: Record, series: int | None) -> int:
        row = (
            self._now_utc(),
            KIND_OF_TYPE[type(record)],
            series,
            *_numbers(record),
            self._text(record),
        )
        # No RETURNING here: with it the commit waits until the row has been fetched to the end.
        command = (
            "INSERT INTO record (at_utc, kind, series, shot, attempt, body)"
            " VALUES (?, ?, ?, ?, ?, ?)"
        )
        with explained(self._path, f"the record {_label(record)} cannot be written"):
            place = self._connection.execute(command, row).lastrowid
        assert place is not None, "an INSERT that succeeds has a row"
        return place

    def _text(self, record: Record) -> str:
        try:
            return to_text(record)
        except (TypeError, ValueError) as error:
            raise JournalFailed(
                f"{self._path}: the record {_label(record)} cannot be written: {error}",
                remedy="a device or the program gave an unusable value: please report this",
            ) from error


def _numbers(record: Record) -> tuple[int | None, int | None]:
    """Shot and attempt, for the records that have them."""
    if isinstance(record, Intent | Outcome | Rejected):
        return record.shot, record.attempt
    return None, None


def _label(record: Record) -> str:
    kind = KIND_OF_TYPE[type(record)]
    shot, attempt = _numbers(record)
    return kind if shot is None else f"{kind} of shot {shot}, attempt {attempt}"
