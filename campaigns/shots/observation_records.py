"""Observations of other kinds than points in the journal: a record for each imported file.

Of each file name the latest import counts, so that a corrected file takes the place of the one
before. A run that measures the planned rows of a file writes a record for each, at once: they are
added to what the journal has of the file, and a row that is measured again replaces its value. A
journal without such records holds no observations.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from campaigns.errors import ObservationsInvalid
from campaigns.journal.journal import Journal, JournalReader
from campaigns.journal.records import Finding, adapter_of, read_body
from campaigns.journal.views import Entry
from campaigns.shots.import_export import FILE_DECIMALS, ImportedFile
from campaigns.shots.observations_csv import ObservationRow

MeasuredRows = dict[tuple[object, ...], ObservationRow]
"""Rows that runs have measured, by the keys of their planned rows."""


@dataclass(frozen=True, slots=True)
class PlannedRow:
    """Row of a file whose value a run measures."""

    row: ObservationRow
    """As it is planned, without a value."""
    repeat: int = 0
    """Number of equal rows before it in the file."""

    @property
    def key(self) -> tuple[object, ...]:
        """Return what makes it this row, wherever it stands in the file, to the file's digits."""
        row = self.row
        joints = tuple(round(value, FILE_DECIMALS) for pose in row.joints for value in pose)
        return (row.kind, row.object, row.pair, row.purpose, joints, self.repeat)


def planned_rows(rows: Iterable[ObservationRow]) -> tuple[PlannedRow, ...]:
    """Return the rows of a file that have no value yet."""
    planned: list[PlannedRow] = []
    counts = Counter[tuple[object, ...]]()
    for row in rows:
        if row.is_planned:
            first = PlannedRow(row)
            planned.append(PlannedRow(row, counts[first.key]))
            counts[first.key] += 1
    return tuple(planned)


@dataclass(frozen=True, slots=True)
class RecordedFile:
    """Imported file of observations, or a single row of one that a run has measured."""

    name: str
    """Name of the file."""
    sha256: str
    """Digest of its bytes; "" if it was no file."""
    rows: tuple[ObservationRow, ...]
    measured: PlannedRow | None = None
    """Planned row that the one row is the measurement of; None: these are all rows of the file."""


@dataclass(frozen=True, slots=True)
class RestatedStd:
    """Observations whose counting σ is smaller than that which was recorded of them first."""

    file: str
    """Name of the file that counts."""
    at_utc: str
    """Time of its record."""
    earlier: str
    """Name of the file that they are in first."""
    earlier_utc: str
    count: int
    """Number of observations."""
    then_mm: float
    """σ then, of the observation of which it fell by the largest factor."""
    now_mm: float


@dataclass(frozen=True, slots=True)
class RecordedObservations:
    """Observations of a journal that count."""

    files: tuple[RecordedFile, ...] = ()
    """Files in the order of their first import, each as it was imported last."""
    record: int = 0
    """Number of the latest record of any; 0 without one."""
    at_utc: str = ""
    """Time of that record."""
    restated: tuple[RestatedStd, ...] = ()
    """Observations of which a larger σ was recorded first."""

    @property
    def rows(self) -> tuple[ObservationRow, ...]:
        """All rows."""
        return tuple(row for file in self.files for row in file.rows)

    @property
    def latest(self) -> str:
        """Name of the file that was imported last; "" without one."""
        return self.files[-1].name if self.files else ""


NO_OBSERVATIONS = RecordedObservations()


def recorded_observations(journal: JournalReader) -> RecordedObservations:
    """Return the observations of a journal; raise `FindingUnreadable` for those it cannot read."""
    entries = journal.findings("observations")
    if not entries:
        return NO_OBSERVATIONS
    records = [_read(entry) for entry in entries]
    files = tuple(
        replace(imported, rows=(*imported.rows, *measured.values()))
        for imported, measured in _counted(records).values()
    )
    times = [entry.at_utc for entry in entries]
    restated = tuple(_restated(zip(times, records, strict=True), files))
    return RecordedObservations(files, entries[-1].number, entries[-1].at_utc, restated)


def measured_rows(journal: JournalReader, name: str) -> MeasuredRows:
    """Return the rows of a file that runs have measured since its latest import.

    By the keys of their planned rows; raise `FindingUnreadable`.
    """
    counted = _counted(map(_read, journal.findings("observations")))
    return counted[name][1] if name in counted else {}


def _counted(records: Iterable[RecordedFile]) -> dict[str, tuple[RecordedFile, MeasuredRows]]:
    """Return by name the latest import of each file and what was measured of its rows since."""
    counted: dict[str, tuple[RecordedFile, MeasuredRows]] = {}
    for file in records:
        if file.measured is None:
            counted.pop(file.name, None)  # the latest import stands last
            counted[file.name] = file, {}
        else:
            _, rows = counted.setdefault(file.name, (RecordedFile(file.name, "", ()), {}))
            (rows[file.measured.key],) = file.rows
    return counted


@dataclass(frozen=True, slots=True)
class _StatedStd:
    """σ of an observation as one record has it."""

    time: str | None
    std_mm: float
    file: str
    at_utc: str


def _restated(
    records: Iterable[tuple[str, RecordedFile]], files: Iterable[RecordedFile]
) -> Iterator[RestatedStd]:
    """Yield counting observations whose first record has a larger σ, by both files."""
    counting = {_as_in_files(row) for file in files for row in file.rows}
    groups: dict[tuple[str, ...], list[tuple[_StatedStd, _StatedStd]]] = {}
    for key, (then, now) in _first_and_latest(records).items():
        if key in counting and then.std_mm > now.std_mm:
            group = (now.file, now.at_utc, then.file, then.at_utc)
            groups.setdefault(group, []).append((then, now))
    for (name, at_utc, earlier, earlier_utc), pairs in groups.items():
        then, now = max(pairs, key=lambda pair: pair[0].std_mm / pair[1].std_mm)
        yield RestatedStd(name, at_utc, earlier, earlier_utc, len(pairs), then.std_mm, now.std_mm)


# What is measured again has another value or time. So equal rows are one measurement, and a smaller
# σ of it was stated when the result by the first σ was known.
def _first_and_latest(
    records: Iterable[tuple[str, RecordedFile]],
) -> dict[tuple[object, ...], tuple[_StatedStd, _StatedStd]]:
    """Return σ of each observation by its first record and by its latest; records with times."""
    first: dict[tuple[object, ...], list[_StatedStd]] = {}
    both: dict[tuple[object, ...], tuple[_StatedStd, _StatedStd]] = {}
    for at_utc, file in records:
        new: list[tuple[tuple[object, ...], _StatedStd]] = []
        for row in file.rows:
            std_mm = round(row.std_mm, FILE_DECIMALS)  # as a file that a run fills in has it
            key = _as_in_files(replace(row, time=None))
            now = _StatedStd(row.time, std_mm, file.name, at_utc)
            of_one = (then for then in first.get(key, ()) if _is_one_time(then.time, row.time))
            both[_as_in_files(row)] = next(of_one, now), now
            new.append((key, now))
        for key, now in new:  # rows of one file are compared with other files alone
            first.setdefault(key, []).append(now)
    return both


def _is_one_time(first: str | None, second: str | None) -> bool:
    """Return whether two times may be of one measurement: they are equal, or one is not stated."""
    return not first or not second or first == second


def append_measured(
    journal: Journal, name: str, planned: PlannedRow, measured: ObservationRow
) -> None:
    """Write the measurement of a file's planned row into the journal, durably."""
    _append(journal, RecordedFile(name, "", (measured,), planned))


def _read(entry: Entry[Finding]) -> RecordedFile:
    """Return a record of observations; raise `FindingUnreadable`."""
    remedy = "import the file again: another version of the software wrote it"
    return read_body(entry.record.body, RecordedFile, "observations", remedy)


def append_observations(
    journal: Journal, rows: Sequence[ObservationRow], file: ImportedFile
) -> None:
    """Write the rows of a file into the journal, in one record."""
    _append(journal, RecordedFile(file.name, file.sha256, tuple(rows)))
    journal.prove()


def _append(journal: Journal, file: RecordedFile) -> None:
    body = adapter_of(RecordedFile).dump_python(file, mode="json")
    journal.append(Finding("observations", body))


# Two measurements may agree to the last digit of callipers or a step of a motor; with times they
# are two.
def refuse_copied_observations(
    rows: Sequence[ObservationRow], others: Iterable[RecordedFile], name: str
) -> None:
    """Raise `ObservationsInvalid` for a row that is a copy of another, or of one in another file.

    A copy would count twice, and a held-out copy of a fitted row would confirm any model.
    """
    seen = {_as_in_files(row): f"{file.name}:{row.line}" for file in others for row in file.rows}
    for row in rows:
        where = seen.setdefault(_as_in_files(row), f"line {row.line}")
        if where != f"line {row.line}":
            raise ObservationsInvalid(
                f"{name}:{row.line}: is a copy of {where}: kind, object, joints and value are "
                "equal to the last digit",
                remedy="leave it out; give the column time if it was measured twice",
            )


def _as_in_files(row: ObservationRow) -> tuple[object, ...]:
    """Return what two measurements differ in, to the digits that files have."""
    numbers = [value for pose in row.joints for value in pose]
    rounded = (round(value, FILE_DECIMALS) for value in (*numbers, *row.values))
    return (row.kind, row.object, row.time, *rounded)
