"""Inspection of a journal from outside: whether it is whole, what is in it, and what is wrong."""

import math
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from pydantic import JsonValue

from campaigns.errors import JournalFailed
from campaigns.journal import views
from campaigns.journal.chain import JournalDamaged, Row
from campaigns.journal.database import (
    connect_to_read,
    missing_rules,
    stored_records,
    verified_end,
    verify_file,
    version,
)
from campaigns.journal.records import (
    Outcome,
    Record,
    Rejected,
    SeriesStarted,
    from_text,
)
from campaigns.journal.views import Entry
from drivers.errors import DriverError
from drivers.values import Matrix3, Vector3

SAME = 1e-12
"""Relative difference of two readings of one text that is none."""
PLACES = 1e-15
"""rad, mm or mm²: the same about zero."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong, and the record it is about where that is known."""

    problem: str
    record: int | None = None


@dataclass(frozen=True, slots=True)
class RawReaders:
    """Readers of raw answers by the name of the driver; both raise `DriverError`."""

    joints: Callable[[str, str], tuple[float, ...]]
    """Joint values in rad or mm."""
    measurement: Callable[[str, str], tuple[Vector3, Matrix3 | None]]
    """Point in mm; covariance in mm², None from a tracker that states none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Inspection:
    """Contents of a journal, and everything that is wrong with it."""

    version: int
    records: int = 0
    chained: int = 0
    """Records that have a digest; those before them are of an older version."""
    digest: str = ""
    """Of the last record, through which it stands for all of them."""
    series: int = 0
    sessions: int = 0
    crashed: int = 0
    shots: int = 0
    """Accepted shots of all series."""
    compared: int = 0
    """Measurements whose raw answers were read again."""
    problems: tuple[Problem, ...] = ()

    @property
    def whole(self) -> bool:
        """Whether nothing is wrong."""
        return not self.problems


def inspect_journal(path: Path, readers: RawReaders) -> Inspection:
    """Inspection of the journal in a file, which is left as it is.

    Raises `JournalFailed` for a file that is missing, not ours, newer than this program, or that
    SQLite does not take for one of its own.
    """
    with closing(connect_to_read(path)) as connection:
        problems = [*_damage(connection, path)]
        rows, digest = _rows(connection)
        entries, unreadable = _entries(rows)
        answers = _Answers(readers, entries)
        for entry in entries:
            answers.compare(entry)
        series = views.all_series(entries)
        return Inspection(
            version=version(connection),
            records=len(rows),
            chained=sum(row[-1] is not None for row in rows),
            digest=digest,
            series=len(series),
            sessions=sum(each.sessions for each in series),
            crashed=sum(each.unstopped for each in series),
            shots=sum(len(each.shots) for each in series),
            compared=answers.compared,
            problems=(*problems, *unreadable, *answers.problems),
        )


def _damage(connection: sqlite3.Connection, path: Path) -> Iterator[Problem]:
    """What chain, pages and rules of the file say."""
    for check in (verified_end, verify_file):
        try:
            check(connection, path)
        except JournalFailed as damaged:
            number = damaged.number if isinstance(damaged, JournalDamaged) else None
            yield Problem(damaged.problem.removeprefix(f"{path}: "), number)
    for rule in missing_rules(connection):
        yield Problem(f"the rule '{rule}' has been taken out of the file")


def _rows(connection: sqlite3.Connection) -> tuple[list[Row], str]:
    """Records as stored, and the digest of the last; none where SQLite cannot read them.

    That is among the damage.
    """
    try:
        rows, stated = stored_records(connection)
    except sqlite3.Error:
        return [], ""
    return rows, stated.digest


def _entries(rows: Sequence[Row]) -> tuple[list[Entry[Record]], list[Problem]]:
    entries: list[Entry[Record]] = []
    problems: list[Problem] = []
    for number, at_utc, kind, series, _, _, body, _ in rows:
        try:
            entries.append(Entry(number, at_utc, series, from_text(kind, body)))
        except ValueError as error:
            problems.append(Problem(f"record {number} cannot be read: {error}", number))
    return entries, problems


class _Answers:
    """Raw answers of the devices, compared with what was parsed from them."""

    def __init__(self, readers: RawReaders, entries: Sequence[Entry[Record]]) -> None:
        self._readers = readers
        self._drivers = {
            entry.series: _drivers(entry.record.configuration)
            for entry in entries
            if isinstance(entry.record, SeriesStarted) and entry.record.stage != "import"
        }
        self.compared = 0
        self.problems: list[Problem] = []

    def compare(self, entry: Entry[Record]) -> None:
        """Note where a measurement is not what the raw answers beside it say."""
        measured = _measured(entry.record)
        controller, tracker = self._drivers.get(entry.series, ("", ""))
        if measured is None or not (controller and tracker):
            return
        self.compared += 1
        try:
            joints = self._readers.joints(controller, measured.raw_robot)
            point_mm, covariance = self._readers.measurement(tracker, measured.raw_tracker)
        except DriverError as error:
            self._note(entry.number, f"a raw answer cannot be read: {error.problem}")
            return
        if not _same(measured.joints, joints):
            self._note(entry.number, f"joints {measured.joints}, the raw answer says {joints}")
        if not _same(measured.point_in_tracker_mm, point_mm):
            said = f"the raw answer says {point_mm}"
            self._note(entry.number, f"point {measured.point_in_tracker_mm} mm, {said}")
        if covariance is not None and not _same(_flat(measured.covariance_mm2), _flat(covariance)):
            said = f"the raw answer says {covariance}"
            self._note(entry.number, f"covariance {measured.covariance_mm2} mm², {said}")

    def _note(self, number: int, text: str) -> None:
        self.problems.append(Problem(f"record {number}: {text}", number))


def _measured(record: Record) -> Outcome | None:
    if isinstance(record, Rejected):
        return record.measured
    return record if isinstance(record, Outcome) else None


def _drivers(configuration: Mapping[str, JsonValue]) -> tuple[str, str]:
    """Drivers of controller and tracker; "" where a series does not say."""
    controller, tracker = (
        str(section.get("driver", "")) if isinstance(section, dict) else ""
        for section in (configuration.get("controller"), configuration.get("tracker"))
    )
    return controller, tracker


def _flat(matrix: Matrix3 | None) -> tuple[float, ...]:
    return () if matrix is None else tuple(chain.from_iterable(matrix))


def _same(parsed: Sequence[float], said: Sequence[float]) -> bool:
    return len(parsed) == len(said) and all(
        math.isclose(one, other, rel_tol=SAME, abs_tol=PLACES)
        for one, other in zip(parsed, said, strict=True)
    )


def require_whole(path: Path, found: Inspection) -> None:
    """Raise `JournalDamaged` that names the first problem of a journal that is not whole."""
    if found.whole:
        return
    first, more = found.problems[0], len(found.problems) - 1
    others = f" (and {more} more)" if more else ""
    raise JournalDamaged(f"{path}: {first.problem}{others}", number=first.record)
