"""Journal of a campaign: its series, accepted shots, crashes and digest."""

import hashlib
import json
from collections.abc import Callable, Collection
from pathlib import Path
from sqlite3 import Connection
from types import TracebackType
from typing import Self, TypeVar

from campaigns.errors import JournalFailed
from campaigns.journal import views
from campaigns.journal.chain import ChainEnd, digest_after
from campaigns.journal.database import (
    checkpoint,
    connect_to_read,
    connect_to_write,
    sqlite_errors_explained,
)
from campaigns.journal.own_file import OwnFile, close_untouched, rescue
from campaigns.journal.records import (
    KIND_OF_TYPE,
    Intent,
    Outcome,
    Record,
    Rejected,
    SeriesFinished,
    SeriesStarted,
    SessionStarted,
    SessionStopped,
    Stage,
    from_text,
    to_text,
)
from campaigns.journal.verification import JournalDamaged, verified_end, verify_file
from campaigns.journal.views import AcceptedShot, Entry, Series

RecordT = TypeVar("RecordT", bound=Record)
_Row = tuple[int, str, str, int | None, str]


def read_journal(path: Path) -> "JournalReader":
    """Open the journal in that file for reading; needs no right to write the folder.

    Raises `JournalFailed` when the file is missing, not ours, newer than this program, or not what
    was written.
    """
    return JournalReader(connect_to_read(path), path)


class JournalReader:
    """Reader of a journal's records, verified when it is made. For one thread.

    Everything raises `JournalFailed`.
    """

    def __init__(self, connection: Connection, path: Path) -> None:
        self._connection = connection
        self._path = path
        self._end = self._verified()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; a second time does nothing."""
        with sqlite_errors_explained(self._path, "the journal cannot be closed"):
            self._connection.close()

    def verify_file(self) -> None:
        """Raise `JournalDamaged` where SQLite finds pages, indexes or rules of the file broken."""
        verify_file(self._connection, self._path)

    def records(self, series: int | None = None) -> tuple[Entry[Record], ...]:
        """Return all records, or those of one series, in their order."""
        return self._entries(KIND_OF_TYPE.values(), series)

    def records_of(
        self, kind: type[RecordT], series: int | None = None
    ) -> tuple[Entry[RecordT], ...]:
        """Return the records of one kind, of all series or of one, in their order."""
        found = self._entries([KIND_OF_TYPE[kind]], series)
        return tuple(
            Entry(entry.number, entry.at_utc, entry.series, entry.record)
            for entry in found
            if isinstance(entry.record, kind)
        )

    def series(self, stage: Stage | None = None) -> tuple[Series, ...]:
        """Return the series of one stage, or of all, oldest first."""
        kinds = (KIND_OF_TYPE[SeriesStarted], KIND_OF_TYPE[SeriesFinished])
        return views.series_of_stage(self._entries(kinds), stage)

    def latest_series(self, stage: Stage) -> Series | None:
        """Return the series of that stage that began last, if any did."""
        found = self.series(stage)
        return found[-1] if found else None

    def next_attempt(self, series: int, shot: int) -> int:
        """Return the number for the next try at a shot, from 1; none is given twice."""
        query = "SELECT max(attempt) FROM record WHERE kind = 'intent' AND series = ? AND shot = ?"
        return self._highest(query, series, shot) + 1

    def shots(self, series: int) -> tuple[AcceptedShot, ...]:
        """Return each shot's latest accepted outcome that was not voided since, by shot number."""
        return views.accepted_shots(self.records(series))

    def unanswered_intents(self, series: int) -> tuple[Intent, ...]:
        """Return what was set out to do and has no end: the process died in between."""
        return views.unanswered_intents(self.records(series))

    def crashed_sessions(self) -> tuple[Entry[SessionStarted], ...]:
        """Return the sessions that never stopped.

        Without the campaign's lock the last of them may be a process that is still at work.
        """
        kinds = (KIND_OF_TYPE[SessionStarted], KIND_OF_TYPE[SessionStopped])
        return views.unstopped_sessions(self._entries(kinds))

    def last_number(self) -> int:
        """Return the place of the last record; 0 in an empty journal."""
        return self._highest("SELECT max(id) FROM record")

    def end(self) -> ChainEnd:
        """Return the end of the chain as it was verified, or written since."""
        return self._end

    def digest(self, *, through: int | None = None) -> str:
        """Return the SHA-256 (hex) over the records as stored, all or up to place `through`."""
        digest = hashlib.sha256()
        for row in self._rows():
            if through is None or row[0] <= through:
                digest.update(json.dumps(row, ensure_ascii=False).encode() + b"\n")
        return digest.hexdigest()

    def _verified(self) -> ChainEnd:
        try:
            return verified_end(self._connection, self._path)
        except BaseException:
            self._connection.close()
            raise

    def _highest(self, query: str, *values: int) -> int:
        """Return the one number that the query asks for; 0 when there is none."""
        with sqlite_errors_explained(self._path, "the journal cannot be read"):
            highest: int | None = self._connection.execute(query, values).fetchone()[0]
        return highest or 0

    def _rows(self) -> list[_Row]:
        query = "SELECT id, at_utc, kind, series, body FROM record ORDER BY id"
        with sqlite_errors_explained(self._path, "the journal cannot be read"):
            return self._connection.execute(query).fetchall()

    def _entries(
        self, kinds: Collection[str], series: int | None = None
    ) -> tuple[Entry[Record], ...]:
        return tuple(
            self._entry(row)
            for row in self._rows()
            if row[2] in kinds and (series is None or row[3] == series)
        )

    def _entry(self, row: _Row) -> Entry[Record]:
        number, at_utc, kind, series, body = row
        try:
            return Entry(number, at_utc, series, from_text(kind, body))
        except ValueError as error:
            problem = f"{self._path}: record {number} cannot be read: {error}"
            raise JournalDamaged(problem, number=number) from error


def open_journal(path: Path, *, now_utc: Callable[[], str], create: bool = False) -> "Journal":
    """Open the journal in that file; `create` makes one where there is none.

    `now_utc` stamps the records. The caller holds the campaign's lock. Raises `JournalFailed` when
    the file is missing, not ours, newer than this program, not what was written, or cannot be
    opened.
    """
    return Journal(connect_to_write(path, create=create), path, now_utc)


class Journal(JournalReader):
    """A journal that grows. Once a record could not be written, no further one is."""

    def __init__(self, connection: Connection, path: Path, now_utc: Callable[[], str]) -> None:
        super().__init__(connection, path)
        self._now_utc = now_utc
        self._own_sessions: set[int] = set()
        self._failed = False
        self._file = OwnFile(path)

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
            self._append(record, series)
        except JournalFailed:
            self._failed = True
            raise
        place = self._end.number
        if isinstance(record, SessionStarted):
            self._own_sessions.add(place)
        return place

    def prove(self) -> None:
        """Close the file and open it anew: all that was written has to be in it, and whole.

        Raises `JournalFailed`. What is asked afterwards is answered by what is on the disk.
        """
        self._check_file()
        written, self._failed = self._end, True  # until it is open again
        self.close()
        self._connection = connect_to_write(self._path, create=False)
        self._end = self._verified()
        self.verify_file()
        if self._end != written:
            raise JournalDamaged(
                f"{self._path}: ends with record {self._end.number}, and {written.number} were "
                "written: it is another file, or records were lost"
            )
        self._file, self._failed = OwnFile(self._path), False

    def crashed_sessions(self) -> tuple[Entry[SessionStarted], ...]:
        """Return the sessions that never stopped, but for those begun here."""
        return tuple(
            entry for entry in super().crashed_sessions() if entry.number not in self._own_sessions
        )

    def _append(self, record: Record, series: int | None) -> None:
        text = self._text(record)
        self._check_file()
        self._insert(record, series, text)
        try:
            self._file.settle(self._end.digest)
            if self._file.wants_checkpoint:
                with sqlite_errors_explained(self._path, "the log cannot be moved into it"):
                    checkpoint(self._connection)
                self._file.settle_checkpoint()
        except JournalFailed as changed:
            raise self._given_up(changed) from changed

    def _check_file(self) -> None:
        with sqlite_errors_explained(self._path, "the journal cannot be written"):
            self._connection.cursor()  # which a closed one does not give
        try:
            self._file.check()
        except JournalFailed as changed:
            raise self._given_up(changed) from changed

    def _insert(self, record: Record, series: int | None, text: str) -> None:
        number = self._end.number + 1
        kind, (shot, attempt) = KIND_OF_TYPE[type(record)], _numbers(record)
        content = (number, self._now_utc(), kind, series, shot, attempt, text)
        digest = digest_after(self._end.digest, content)
        # No RETURNING here: with it the commit waits until the row has been fetched to the end.
        command = (
            "INSERT INTO record (id, at_utc, kind, series, shot, attempt, body, digest)"
            " VALUES (?, ?, ?, ?, ?, ?, ?, ?)"
        )
        with sqlite_errors_explained(self._path, f"the record {_label(record)} cannot be written"):
            self._connection.execute(command, (*content, digest))
        self._end = ChainEnd(number, digest)

    def _given_up(self, changed: JournalFailed) -> JournalFailed:
        """Error for a file that others have changed; keeps what can still be read in another."""
        kept = rescue(self._connection, self._path, self._is_whole)
        close_untouched(self._connection, self._path)
        if kept is None:
            return changed
        return JournalFailed(
            changed.problem,
            remedy=f"its {self._end.number} records are whole in {kept.name}: move campaign.db and "
            f"campaign.db-wal away, rename {kept.name} to campaign.db, and start again: it resumes",
        )

    def _is_whole(self, copy: Path) -> bool:
        try:
            with read_journal(copy) as reader:
                return reader.end() == self._end
        except JournalFailed:
            return False

    def _text(self, record: Record) -> str:
        try:
            return to_text(record)
        except (TypeError, ValueError, AttributeError) as error:
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
