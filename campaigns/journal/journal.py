"""Journal of a campaign: its records, series, accepted shots and digest."""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from sqlite3 import Connection
from types import TracebackType
from typing import Self, TypeVar

from campaigns.errors import JournalFailed
from campaigns.journal import database, views
from campaigns.journal import records as kinds
from campaigns.journal.digest_chain import ChainEnd, JournalDamaged, Row, as_json, digest_after
from campaigns.journal.own_file import (
    OwnFile,
    close_refused,
    close_untouched,
    free_name,
    take_rescued,
)
from campaigns.journal.views import AcceptedShot, Entry, Series

RecordT = TypeVar("RecordT", bound=kinds.Record)


def read_journal(path: Path) -> "JournalReader":
    """Open the journal in that file for reading; needs no right to write the folder.

    Raises `JournalFailed` when the file is missing, not ours, newer than this program, or not what
    was written.
    """
    return JournalReader(database.connect_to_read(path), path)


class JournalReader:
    """Reader of a journal's records, verified when it is made. For one thread.

    Everything raises `JournalFailed`.
    """

    def __init__(self, connection: Connection, path: Path) -> None:
        self._connection = connection
        self._path = path
        self._entries: list[Entry[kinds.Record]] = []
        self._rows: list[Row] = []
        """Records as stored, all that were read or written so far."""
        self._end = self._verify()

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
        with database.sqlite_errors_explained(self._path, "the journal cannot be closed"):
            self._connection.close()

    def records(self, series: int | None = None) -> tuple[Entry[kinds.Record], ...]:
        """Return all records, or those of one series, in their order."""
        self._read_further()
        self._entries += [self._entry(row) for row in self._rows[len(self._entries) :]]
        if series is None:
            return tuple(self._entries)
        return tuple(entry for entry in self._entries if entry.series == series)

    def records_of(
        self, kind: type[RecordT], series: int | None = None
    ) -> tuple[Entry[RecordT], ...]:
        """Return the records of one kind, of all series or of one, in their order."""
        return tuple(
            Entry(entry.number, entry.at_utc, entry.series, entry.record)
            for entry in self.records(series)
            if isinstance(entry.record, kind)
        )

    def series(self, stage: kinds.Stage | None = None) -> tuple[Series, ...]:
        """Return the series of one stage, or of all, oldest first."""
        every = views.all_series(self.records())
        return tuple(each for each in every if stage in (None, each.started.stage))

    def latest_series(self, stage: kinds.Stage) -> Series | None:
        """Return the series of that stage that began last, if any did."""
        return next(reversed(self.series(stage)), None)

    def shots(self, series: int) -> tuple[AcceptedShot, ...]:
        """Return each shot's latest accepted outcome that was not voided since, by shot number."""
        return next((each.shots for each in self.series() if each.number == series), ())

    def last_number(self) -> int:
        """Return the place of the last record; 0 in an empty journal."""
        return len(self.records())

    def end(self) -> ChainEnd:
        """Return the end of the chain as it was verified, or written since."""
        return self._end

    def holds(self, end: ChainEnd) -> bool:
        """Whether a record of this number and digest is in it: then all before that are, too."""
        self._read_further()
        return any(row[0] == end.number and row[-1] == end.digest for row in self._rows)

    def digest(self, *, through: int | None = None) -> str:
        """Return the SHA-256 (hex) over the records as stored, all or up to place `through`.

        Of records that were read before also once it is closed.
        """
        if through is None or through > len(self._rows):
            self._read_further()
        digest = hashlib.sha256()
        for number, at_utc, kind, series, _, _, body, _ in self._rows[:through]:
            digest.update(as_json((number, at_utc, kind, series, body)) + b"\n")
        return digest.hexdigest()

    def _verify(self) -> ChainEnd:
        try:
            self._rows, end = database.verified_records(self._connection, self._path)
        except BaseException:
            close_refused(self._connection, self._path)
            raise
        return end

    def _read_further(self) -> None:
        """Read the records that another process has written since."""
        with database.sqlite_errors_explained(self._path, "the journal cannot be read"):
            self._rows += database.records_after(self._connection, len(self._rows))

    def _entry(self, row: Row) -> Entry[kinds.Record]:
        number, at_utc, kind, series, _, _, body, _ = row
        try:
            return Entry(number, at_utc, series, kinds.from_text(kind, body))
        except ValueError as error:
            problem = f"{self._path}: record {number} cannot be read: {error}"
            raise JournalDamaged(problem, number=number) from error


def open_journal(
    path: Path, *, now_utc: Callable[[], str], create: bool = False, waits_for_disk: bool = True
) -> "Journal":
    """Open the journal in that file; `create` makes one where there is none.

    `now_utc` stamps the records. The caller holds the campaign's lock. Raises `JournalFailed` when
    the file is missing, not ours, newer than this program, not what was written, or cannot be
    opened. A record of which nobody `waits_for_disk` outlives the process, and not a power cut.
    """
    connection = database.connect_to_write(path, create=create, waits_for_disk=waits_for_disk)
    try:
        return Journal(connection, path, now_utc, waits_for_disk=waits_for_disk)
    except JournalDamaged as damaged:
        if not damaged.whole:
            raise
        raise _kept_in_copy(damaged, path, damaged.whole) from damaged


def _kept_in_copy(failed: JournalFailed, path: Path, rows: Sequence[Row]) -> JournalFailed:
    """Write records into a copy beside the journal, and return the error that names it."""
    copy = free_name(path)
    try:
        database.make_whole(copy, rows)
    except JournalFailed:
        return failed
    return JournalFailed(
        failed.problem,
        remedy=f"its {len(rows)} records are whole in {copy.name}: {take_rescued(copy.name)}",
    )


class Journal(JournalReader):
    """A journal that grows. Once a record could not be written, no further one is."""

    def __init__(
        self,
        connection: Connection,
        path: Path,
        now_utc: Callable[[], str],
        *,
        waits_for_disk: bool = True,
    ) -> None:
        super().__init__(connection, path)
        self._now_utc = now_utc
        self._waits_for_disk = waits_for_disk
        self._failed = self._is_open = False
        self._file = OwnFile(path, self._is_whole)

    def start_series(self, started: kinds.SeriesStarted) -> int:
        """Begin a new series and return its number."""
        series = 1 + max((each.series or 0 for each in self.records()), default=0)
        self.append(started, series=series)
        return series

    def append(self, record: kinds.Record, *, series: int | None = None) -> int:
        """Write one record, durable on return, and return its place in the journal.

        Only an `Event` or a `Finding` may do without a series. Raises `JournalFailed`.
        """
        if self._failed:
            raise JournalFailed(
                f"{self._path}: a record could not be written before, so none is written any more",
                remedy="see the first error; start the command again, it resumes",
            )
        try:
            if self._is_open:
                self._insert(series, self._as_stored(record), record)
            else:
                self._append(record, series)
        except JournalFailed:
            self._failed = True
            raise
        return self._end.number

    @contextmanager
    def in_one_commit(self) -> Iterator[None]:
        """Make what is appended inside durable at its end, all of it, or nothing on any error.

        Raises `JournalFailed`.
        """
        self._check_file()
        before, self._is_open = self._end, True
        explained = database.sqlite_errors_explained(self._path, "the records cannot be written")
        try:
            with explained, database.in_one_commit(self._connection):
                yield
        except BaseException as error:
            self._end = before
            del self._rows[before.number :], self._entries[before.number :]
            self._failed |= isinstance(error, JournalFailed)
            raise
        finally:
            self._is_open = False
        self._check_file()

    def prove(self) -> None:
        """Close the file and open it anew: all that was written has to be in it, and whole.

        Raises `JournalFailed`. What is asked afterwards is answered by what is on the disk.
        """
        self._check_file()
        rows, self._failed = self._rows, True  # until it is open again
        self.close()
        try:
            self._open_anew()
        except JournalFailed as failed:
            raise _kept_in_copy(failed, self._path, rows[: self._end.number]) from failed
        self._entries, self._failed = [], False
        self._file = OwnFile(self._path, self._is_whole)

    def _open_anew(self) -> None:
        self._connection = database.connect_to_write(
            self._path, create=False, waits_for_disk=self._waits_for_disk
        )
        end = self._verify()
        if end != self._end:
            raise JournalDamaged(
                f"{self._path}: ends with record {end.number}, and {self._end.number} were "
                "written: it is another file, or records were lost"
            )

    def _append(self, record: kinds.Record, series: int | None) -> None:
        stored = self._as_stored(record)
        self._check_file()
        self._insert(series, stored, record)
        self._check_file()

    def _check_file(self) -> None:
        """Stop if the journal's file is no longer the one that was written; keep its records."""
        with database.sqlite_errors_explained(self._path, "the journal cannot be written"):
            self._connection.cursor()  # which a closed one does not give
        try:
            self._file.check()
            self._check_last_number()
        except JournalFailed as changed:
            close_untouched(self._connection, self._path)
            raise _kept_in_copy(changed, self._path, self._rows[: self._end.number]) from changed

    def _check_last_number(self) -> None:
        with database.sqlite_errors_explained(self._path, "the journal cannot be read"):
            last = database.last_number(self._connection)
        if last != self._end.number:
            raise JournalDamaged(f"{self._path}: record {last} was written by another program")

    def _insert(self, series: int | None, text: str, record: kinds.Record) -> None:
        """Write a record with this text."""
        number, at_utc = self._end.number + 1, self._now_utc()
        kind, (shot, attempt) = kinds.KIND_OF_TYPE[type(record)], _numbers(record)
        content = (number, at_utc, kind, series, shot, attempt, text)
        digest = digest_after(self._end.digest, content)
        # No RETURNING here: with it the commit waits until the row has been fetched to the end.
        command = (
            "INSERT INTO record (id, at_utc, kind, series, shot, attempt, body, digest)"
            " VALUES (?, ?, ?, ?, ?, ?, ?, ?)"
        )
        with database.sqlite_errors_explained(
            self._path, f"the record {_label(record)} cannot be written"
        ):
            self._connection.execute(command, (*content, digest))
        self._rows.append((*content, digest))
        self._end = ChainEnd(number, digest)

    def _is_whole(self) -> bool:
        return database.is_whole(self._path, self._end)

    def _as_stored(self, record: kinds.Record) -> str:
        try:
            return kinds.as_stored(record)
        except (TypeError, ValueError, AttributeError) as error:
            raise JournalFailed(
                f"{self._path}: the record {_label(record)} cannot be written: {error}",
                remedy="a device or the program gave an unusable value: please report this",
            ) from error


def _numbers(record: kinds.Record) -> tuple[int | None, int | None]:
    """Shot and attempt, for the records that have them."""
    if isinstance(record, kinds.Intent | kinds.Outcome | kinds.Rejected):
        return record.shot, record.attempt
    return None, None


def _label(record: kinds.Record) -> str:
    kind = kinds.KIND_OF_TYPE[type(record)]
    shot, attempt = _numbers(record)
    return kind if shot is None else f"{kind} of shot {shot}, attempt {attempt}"
