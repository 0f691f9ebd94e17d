"""Observations of other kinds than points in the journal: a record for each imported file.

Of each file name the latest record counts, so that a corrected file takes the place of the one
before. A journal without such a record holds no observations.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from campaigns.errors import ObservationsInvalid
from campaigns.journal.journal import Journal, JournalReader
from campaigns.journal.records import Finding, adapter_of, read_body
from campaigns.shots.import_export import FILE_DECIMALS, ImportedFile
from campaigns.shots.observations_csv import ObservationRow


@dataclass(frozen=True, slots=True)
class RecordedFile:
    """Imported file of observations."""

    name: str
    """Name of the file."""
    sha256: str
    """Digest of its bytes; "" if it was no file."""
    rows: tuple[ObservationRow, ...]


@dataclass(frozen=True, slots=True)
class RecordedObservations:
    """Observations of a journal that count."""

    files: tuple[RecordedFile, ...] = ()
    """Files in the order of their first import, each as it was imported last."""
    record: int = 0
    """Number of the latest record of any; 0 without one."""
    at_utc: str = ""
    """Time of that record."""

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
    files: dict[str, RecordedFile] = {}
    entries = journal.findings("observations")
    for entry in entries:
        remedy = "import the file again: another version of the software wrote it"
        file = read_body(entry.record.body, RecordedFile, "observations", remedy)
        files.pop(file.name, None)  # the latest import stands last
        files[file.name] = file
    if not entries:
        return NO_OBSERVATIONS
    return RecordedObservations(tuple(files.values()), entries[-1].number, entries[-1].at_utc)


def append_observations(
    journal: Journal, rows: Sequence[ObservationRow], file: ImportedFile
) -> None:
    """Write the rows of a file into the journal, in one record."""
    recorded = RecordedFile(file.name, file.sha256, tuple(rows))
    body = adapter_of(RecordedFile).dump_python(recorded, mode="json")
    journal.append(Finding("observations", body))
    journal.prove()


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
