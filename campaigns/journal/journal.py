"""Journal of a campaign: its records, series, accepted shots and digest."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from sqlite3 import Connection
from typing import Self, TypeVar

from campaigns.errors import JournalFailed
from campaigns.journal import database, views
from campaigns.journal import records as kinds
from campaigns.journal.database import StoredRecord
from campaigns.journal.journal_files import (
    FROM_BACKUP,
    close_untouched,
    file_states,
    next_rescued_copy,
    require_same,
    take_rescued,
)
from campaigns.journal.verification import (
    JournalDamaged,
    digest_after,
    is_whole,
    last_digest,
    require_whole,
    verify,
)
from campaigns.journal.views import AcceptedShot, Entry, Series

RecordT = TypeVar("RecordT", bound=kinds.Record)


def read_journal(path: Path) -> "JournalReader":
    """Open the journal in that file for reading; needs no right to write the folder.

    Raises `JournalFailed` when the file is missing, not ours, newer than this program, or not what
    was written.
    """
    return JournalReader(path, database.connect_to_read(path))


class JournalReader:
    """Reader of a journal's records, all verified when it is made. For one thread.

    Everything raises `JournalFailed`.
    """

    def __init__(self, path: Path, connection: Connection) -> None:
        self._path = path
        self._open(connection)

    def _open(self, connection: Connection) -> None:
        """Verify the file, and read all records; closes the connection if they do not verify."""
        self._connection = connection
        self._entries: list[Entry[kinds.Record]] = []
        try:
            verified = verify(connection, self._path)
            require_whole(self._path, verified.problems, verified.records)
        except BaseException:
            close_untouched(connection, self._path)
            raise
        self._stored = verified.records

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; a second time does nothing."""
        with database.sqlite_errors_explained(self._path, "the journal cannot be closed"):
            self._connection.close()

    def records(self, series: int | None = None) -> tuple[Entry[kinds.Record], ...]:
        """Return all records, or those of one series, in their order."""
        self._read_further()
        try:
            for stored in self._stored[len(self._entries) :]:
                self._entries.append(views.entry_of(stored))
        except ValueError as error:
            raise JournalDamaged(f"{self._path}: {error}") from error
        return tuple(entry for entry in self._entries if series in (None, entry.series))

    def records_of(
        self, kind: type[RecordT], series: int | None = None
    ) -> tuple[Entry[RecordT], ...]:
        """Return the records of one kind, of all series or of one, in their order."""
        return tuple(
            Entry(entry.number, entry.at_utc, entry.series, entry.record)
            for entry in self.records(series)
            if isinstance(entry.record, kind)
        )

    def findings(self, kind: kinds.FindingKind) -> tuple[Entry[kinds.Finding], ...]:
        """Return the findings of one kind, in their order."""
        return tuple(each for each in self.records_of(kinds.Finding) if each.record.kind == kind)

    def series(self, stage: kinds.Stage | None = None) -> tuple[Series, ...]:
        """Return the series of one stage, or of all, oldest first."""
        every = views.all_series(self.records())
        return tuple(series for series in every if stage in (None, series.started.stage))

    def latest_series(self, stage: kinds.Stage) -> Series | None:
        """Return the series of that stage that began last, if any did."""
        return next(reversed(self.series(stage)), None)

    def shots(self, series: int) -> tuple[AcceptedShot, ...]:
        """Return each shot's latest accepted outcome that was not voided since, by shot number."""
        return next((each.shots for each in self.series() if each.number == series), ())

    def last_number(self) -> int:
        """Return the place of the last record, others' later ones too; 0 in an empty journal."""
        self._read_further()
        return len(self._stored)

    def digest(self, *, through: int | None = None) -> str:
        """Return the digest of the last record, or of that at place `through`; "" before the first.

        It stands for all records up to this one. Raises `IndexError` beyond the last.
        """
        if through is None or through > len(self._stored):
            self._read_further()
        last = len(self._stored) if through is None else through
        return last_digest(self._stored[last - 1 : last]) if last else ""

    def holds(self, number: int, digest: str) -> bool:
        """Whether a record of this number and digest is in it: then all before that are, too."""
        return number <= self.last_number() and self.digest(through=number) == digest

    def _read_further(self) -> None:
        """Read the records that another process has written since."""
        with database.sqlite_errors_explained(self._path, "the journal cannot be read"):
            self._stored += database.records_after(self._connection, len(self._stored))


def open_journal(
    path: Path, *, now_utc: Callable[[], str], waits_for_disk: bool = True
) -> "Journal":
    """Open the journal in that file, or make it; `now_utc` stamps the records.

    The caller holds the campaign's lock. Raises `JournalFailed` when the file is not ours, newer
    than this program, not what was written, or cannot be opened. Of a damaged one, the records that
    verify are kept in a copy. Unless it `waits_for_disk`, a power cut may take the last records.
    """
    try:
        return Journal(path, now_utc, waits_for_disk=waits_for_disk)
    except JournalDamaged as damaged:
        kept = _keep_in_copy(path, damaged.verified)
        remedy = f"{FROM_BACKUP}; without one: {kept}" if kept else FROM_BACKUP
        raise JournalFailed(damaged.problem, remedy=remedy) from damaged


def _keep_in_copy(path: Path, records: Sequence[StoredRecord]) -> str:
    """Write records into a copy beside the journal; return what to do with it, "" without one."""
    if not records:
        return ""
    copy = next_rescued_copy(path)
    try:
        database.create_journal(copy, records)
    except JournalFailed:
        return ""
    return f"its {len(records)} records are whole in {copy.name}: {take_rescued(copy.name)}"


class Journal(JournalReader):
    """A journal that grows. Once a record could not be written, no further one is."""

    def __init__(
        self, path: Path, now_utc: Callable[[], str], *, waits_for_disk: bool = True
    ) -> None:
        self._now_utc = now_utc
        self._waits_for_disk = waits_for_disk
        self._failed = self._in_commit = False
        super().__init__(path, database.connect_to_write(path))

    def _open(self, connection: Connection) -> None:
        super()._open(connection)
        database.prepare_to_write(connection, self._path, waits_for_disk=self._waits_for_disk)
        self._files = file_states(self._path)

    def start_series(self, started: kinds.SeriesStarted) -> int:
        """Begin a new series and return its number."""
        series = 1 + max((record.series or 0 for record in self._stored), default=0)
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
            if self._in_commit:
                self._insert(record, series)
            else:
                self._require_same_files()
                self._insert(record, series)
                self._require_same_files()  # and note how long they are now
        except JournalFailed:
            self._failed = True
            raise
        return len(self._stored)

    @contextmanager
    def in_one_commit(self) -> Iterator[None]:
        """Make what is appended inside durable at its end, all of it, or nothing on any error.

        Raises `JournalFailed`.
        """
        self._require_same_files()
        before, self._in_commit = len(self._stored), True
        explained = database.sqlite_errors_explained(self._path, "the records cannot be written")
        try:
            with explained, database.transaction(self._connection, "WRITE"):
                yield
        except BaseException as error:
            del self._stored[before:], self._entries[before:]
            self._failed |= isinstance(error, JournalFailed)
            raise
        finally:
            self._in_commit = False
        self._require_same_files()

    def prove(self) -> None:
        """Close the file and open it again: all that was written has to be in it, and whole.

        A second connection beside the first would not do: it reads by the same index in memory.
        Raises `JournalFailed`.
        """
        self._require_same_files()
        written = self._stored
        self.close()
        try:
            self._open(database.connect_to_write(self._path))
            if last_digest(self._stored) != last_digest(written):
                raise JournalDamaged(
                    f"{self._path}: ends with record {len(self._stored)}, and {len(written)} were "
                    "written: it is another file, or records were lost"
                )
        except JournalFailed as failed:
            self._failed = True
            kept = _keep_in_copy(self._path, written)
            raise JournalFailed(failed.problem, remedy=kept or failed.remedy) from failed

    def _require_same_files(self) -> None:
        """Stop if the journal's files are no longer those that were opened; keep the records."""
        with database.sqlite_errors_explained(self._path, "the journal cannot be written"):
            self._connection.cursor()  # which a closed one does not give
        try:
            before, self._files = self._files, file_states(self._path)
            last, digest = len(self._stored), last_digest(self._stored)
            require_same(before, self._files, lambda: is_whole(self._path, last, digest))
        except JournalFailed as changed:
            close_untouched(self._connection, self._path)
            kept = _keep_in_copy(self._path, self._stored)
            raise JournalFailed(changed.problem, remedy=kept or changed.remedy) from changed

    def _insert(self, record: kinds.Record, series: int | None) -> None:
        shot, attempt = (getattr(record, name, None) for name in ("shot", "attempt"))
        kind = kinds.KIND_OF_TYPE[type(record)]
        label = kind if shot is None else f"{kind} of shot {shot}, attempt {attempt}"
        number, at_utc = len(self._stored) + 1, self._now_utc()
        try:
            body = kinds.as_stored(record)
        except (TypeError, ValueError, AttributeError) as error:
            raise JournalFailed(
                f"{self._path}: the record {label} cannot be written: {error}",
                remedy="a device or the program gave an unusable value: please report this",
            ) from error
        stored = StoredRecord(number, at_utc, kind, series, shot, attempt, body, None)
        stored = stored._replace(digest=digest_after(last_digest(self._stored), stored))
        with database.sqlite_errors_explained(self._path, f"the record {label} cannot be written"):
            database.insert(self._connection, stored)
        self._stored.append(stored)
