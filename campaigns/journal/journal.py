"""Journal of a campaign: its records, series, accepted shots and digest.

Results, reports and resuming are computed from the journal. Opening it verifies every record
(`verification.py`) and keeps all in memory; a reader adds what other processes write later.

`Journal.append` is one commit, durable on return, and the caller acts only afterwards. A crash
therefore loses at most the attempt that was going on, and its intent shows which one that was.
After a failed write no further record is written: a journal with a gap would look complete.

SQLite goes on writing through its open file even if that file was deleted or replaced, and its
records would vanish with it. So the files are compared before and after each record, and the run
ends with `prove`, which reads everything again through a new connection. The records in memory are
what a lost or damaged file is rescued from, whatever failed: into a copy beside the journal, never
over it.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from sqlite3 import Connection
from typing import Self, TypeVar

from campaigns.errors import JournalFailed
from campaigns.journal import database, views
from campaigns.journal import records as kinds
from campaigns.journal.database import StoredRecord
from campaigns.journal.journal_files import (
    FROM_BACKUP,
    FilesChanged,
    close_untouched,
    file_states,
    next_rescued_copy,
    require_same,
    take_rescued,
)
from campaigns.journal.verification import (
    JournalDamaged,
    digest_after,
    has_all,
    last_digest,
    require_whole,
    verify,
    verify_chain,
)
from campaigns.journal.views import AcceptedShot, Entry, Series

RecordT = TypeVar("RecordT", bound=kinds.Record)


def read_journal(path: Path) -> "JournalReader":
    """Open the journal in that file for reading; needs no right to write the folder.

    Raise `JournalFailed` if the file is missing, not a journal, newer than this program, or
    damaged.
    """
    return JournalReader(path, database.connect_to_read(path))


class JournalReader:
    """Reader of a journal's records, all verified when it is made. For one thread.

    All methods raise `JournalFailed` if the file cannot be read.
    """

    def __init__(self, path: Path, connection: Connection) -> None:
        self._path = path
        self._open(connection)

    def _open(self, connection: Connection) -> None:
        """Verify the file, and read all records; close the connection if they do not verify."""
        self._connection = connection
        # The records twice: `_stored` as rows with their digests, from which a lost file is
        # rescued, and `_entries` as values, made of the rows only when somebody asks for them.
        self._entries: list[Entry[kinds.Record]] = []
        try:
            verified = verify(connection, self._path)
            require_whole(self._path, verified.problems, verified.records)
        except BaseException:
            # A plain close moves the log into the database: a damaged file has to stay as it is.
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
        return tuple(
            finding for finding in self.records_of(kinds.Finding) if finding.record.kind == kind
        )

    def series(self, stage: kinds.Stage | None = None) -> tuple[Series, ...]:
        """Return the series of one stage, or of all, oldest first."""
        all_series = views.all_series(self.records())
        return tuple(series for series in all_series if stage in (None, series.started.stage))

    def latest_series(self, stage: kinds.Stage) -> Series | None:
        """Return the series of a stage that began last; None if the stage was never begun."""
        return next(reversed(self.series(stage)), None)

    def shots(self, series: int) -> tuple[AcceptedShot, ...]:
        """Return the shots of a series that count, by shot number.

        Of each shot that is its latest accepted outcome, unless a later record voids the outcome.
        """
        return next((row.shots for row in self.series() if row.number == series), ())

    def last_number(self) -> int:
        """Return the place of the last record; 0 in an empty journal.

        Records that other processes have written since the opening count.
        """
        self._read_further()
        return len(self._stored)

    def digest(self, *, through: int | None = None) -> str:
        """Return the digest of the last record, or of the record at place `through`.

        The digest stands for all records up to this one; it is "" before the first. Raise
        `IndexError` if there are fewer than `through` records.
        """
        if through is None or through > len(self._stored):
            self._read_further()
        last = len(self._stored) if through is None else through
        return last_digest(self._stored[last - 1 : last]) if last else ""

    def holds(self, number: int, digest: str) -> bool:
        """Return whether the journal has a record of this number and digest.

        The digest chains each record to the one before, so that all earlier records are in it, too.
        """
        return number <= self.last_number() and self.digest(through=number) == digest

    def _read_further(self) -> None:
        """Read the records that another process has written since, and verify their chain.

        The records before are not read again: the next opening verifies all of them.
        """
        with database.sqlite_errors_explained(self._path, "the journal cannot be read"):
            # One moment for the records and the stated end, unless a commit is open already.
            is_open = self._connection.in_transaction
            with nullcontext() if is_open else database.transaction(self._connection, "READ"):
                further = [*database.records_after(self._connection, len(self._stored))]
                stated = database.stated_end(self._connection)
        if further:
            chain = verify_chain(further, *stated, before=self._stored)
            require_whole(self._path, chain.problems, chain.records)
            self._stored = chain.records


def open_journal(
    path: Path, *, now_utc: Callable[[], str], waits_for_disk: bool = True
) -> "Journal":
    """Open the journal in that file, or make it; `now_utc` stamps the records.

    The caller holds the campaign's lock. Raise `JournalFailed` if the file is not a journal, newer
    than this program, damaged, or cannot be opened. The records of a damaged journal that verify
    are kept in a copy. With `waits_for_disk` false, a power cut may take the last records.
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
        # Without a copy, then: this error must not hide the one that is about to be raised.
        return ""
    return f"its {len(records)} records are whole in {copy.name}: {take_rescued(copy.name)}"


class Journal(JournalReader):
    """Journal that grows. Once a record could not be written, no further one is."""

    def __init__(
        self, path: Path, now_utc: Callable[[], str], *, waits_for_disk: bool = True
    ) -> None:
        self._now_utc = now_utc
        self._waits_for_disk = waits_for_disk
        self._failed = self._in_commit = self._is_rescued = False
        super().__init__(path, database.connect_to_write(path))

    def _open(self, connection: Connection) -> None:
        # Verified first: preparing may upgrade the file, and a damaged one must not be touched.
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

        Only an `Event` or a `Finding` may belong to no series. Raise `JournalFailed`.
        """
        if self._failed:
            raise JournalFailed(
                f"{self._path}: a record could not be written before, so none is written any more",
                remedy="see the first error; start the command again, it resumes",
            )
        with self._rescued_on_failure():
            if self._in_commit:
                self._insert(record, series)
            else:
                # Before: a file that was deleted or replaced must not be given another record.
                self._require_same_files()
                self._insert(record, series)
                # After: the file may have gone while the record was written, and this notes how
                # long the files are now, for the next comparison.
                self._require_same_files()
        return len(self._stored)

    @contextmanager
    def _rescued_on_failure(self) -> Iterator[None]:
        """Write no further record once the block fails, and keep the records in memory.

        They are rescued into a copy, which the error names, unless the journal has them all.
        """
        try:
            yield
        except JournalFailed as failed:
            self._failed = True
            # A commit is rolled back first: then the block around it comes here.
            if self._in_commit or self._is_rescued:
                raise
            last, digest = len(self._stored), last_digest(self._stored)
            # Of exchanged files it does not count that they are whole: this process's log would
            # still be moved into them.
            if not isinstance(failed, FilesChanged) and has_all(self._path, last, digest):
                raise
            close_untouched(self._connection, self._path)
            kept = _keep_in_copy(self._path, self._stored)
            self._is_rescued = bool(kept)
            raise JournalFailed(failed.problem, remedy=kept or failed.remedy) from failed

    @contextmanager
    def in_one_commit(self) -> Iterator[None]:
        """Make what is appended inside durable at its end, all of it, or nothing on any error.

        For an import, whose records count only together. Raise `JournalFailed`.
        """
        explained = database.sqlite_errors_explained(self._path, "the records cannot be written")
        with self._rescued_on_failure():
            self._require_same_files()
            before, self._in_commit = len(self._stored), True
            try:
                with explained, database.transaction(self._connection, "WRITE"):
                    yield
            except BaseException:
                # The database has rolled back: so must the copy in memory, or the next record would
                # be chained to one that the file does not have.
                del self._stored[before:], self._entries[before:]
                raise
            finally:
                self._in_commit = False
            self._require_same_files()

    def prove(self) -> None:
        """Close the file, open it again, and verify that all written records are in it.

        Raise `JournalFailed`, with the records rescued into a copy, if they are not.
        """
        # A second connection beside the first would prove nothing: as long as the first one is
        # open, SQLite's index of the log in shared memory answers for a file that was exchanged or
        # cut.
        written = self._stored
        with self._rescued_on_failure():
            self._require_same_files()
            self.close()
            self._open(database.connect_to_write(self._path))
            read, self._stored = self._stored, written
            # The chain verifies: equal last digests mean that all records are equal.
            if last_digest(read) != last_digest(written):
                raise JournalDamaged(
                    f"{self._path}: ends with record {len(read)}, and {len(written)} were "
                    "written: it is another file, or records were lost"
                )

    def _require_same_files(self) -> None:
        """Raise `FilesChanged` if the files are no longer those that were opened."""
        with database.sqlite_errors_explained(self._path, "the journal cannot be written"):
            self._connection.cursor()  # fails on a connection that is closed
        before, self._files = self._files, file_states(self._path)
        last, digest = len(self._stored), last_digest(self._stored)
        require_same(before, self._files, lambda: has_all(self._path, last, digest))

    def _insert(self, record: kinds.Record, series: int | None) -> None:
        # Number and digest follow the copy in memory, not the file: if another program has added a
        # record, the number is taken there, and the triggers refuse ours. The copy grows last, so
        # that it never holds a record that the file lacks.
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
