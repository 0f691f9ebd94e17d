"""Inspection of a journal from outside: whether it is whole, what is in it, and what is wrong."""

import math
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TypeAlias

from campaigns.errors import JournalFailed
from campaigns.journal import database, views
from campaigns.journal.digest_chain import JournalDamaged, Row
from campaigns.journal.own_file import close_refused
from campaigns.journal.records import Outcome, Record, Rejected, SeriesStarted, from_text
from campaigns.journal.views import Entry
from drivers.errors import DriverError
from drivers.values import Matrix3, Vector3

SAME = 1e-12
"""Relative difference of two readings of one text that is none."""
PLACES = 1e-15
"""rad, mm or mm²: the same about zero."""

RawReaders: TypeAlias = tuple[
    Callable[[str, str], tuple[float, ...]], Callable[[str, str], tuple[Vector3, Matrix3 | None]]
]
"""Readers of raw answers by the name of the driver, which raise `DriverError`.

Of joints, rad or mm; of a point, mm, with its covariance, mm², None from a tracker without one.
"""


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong, and the record it is about where that is known."""

    problem: str
    record: int | None = None


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
    connection, found = database.connect_to_read(path), None
    try:
        with database.sqlite_errors_explained(path, "the journal cannot be read"):
            found = _inspection(connection, path, readers)
    finally:
        if found is not None and found.whole:
            connection.close()
        else:
            close_refused(connection, path)
    return found


def _inspection(connection: sqlite3.Connection, path: Path, readers: RawReaders) -> Inspection:
    problems = [*_damage(connection, path)]
    rows, digest = list[Row](), ""
    with suppress(sqlite3.Error):  # which is among the damage
        rows, stated = database.stored_records(connection)
        digest = stated.digest
    entries, unreadable = _entries(rows)
    series = views.all_series(entries)
    drivers: dict[int | None, tuple[str, str]] = {
        each.number: _drivers(each.started) for each in series
    }
    measured = [
        (entry.number, outcome, drivers[entry.series])
        for entry in entries
        if (outcome := _measured(entry.record)) and all(drivers.get(entry.series, ("", "")))
    ]
    wrong = [
        Problem(f"record {n}: {text}", n)
        for n, o, by in measured
        for text in _said_otherwise(readers, o, *by)
    ]
    return Inspection(
        version=database.version(connection),
        records=len(rows),
        chained=sum(row[-1] is not None for row in rows),
        digest=digest,
        series=len(series),
        sessions=sum(each.sessions for each in series),
        crashed=sum(each.unstopped for each in series),
        shots=sum(len(each.shots) for each in series),
        compared=len(measured),
        problems=(*problems, *unreadable, *wrong),
    )


def _damage(connection: sqlite3.Connection, path: Path) -> Iterator[Problem]:
    """What chain, pages and rules of the file say."""
    for check in (database.verified_records, database.verify_file):
        try:
            check(connection, path)
        except JournalFailed as damaged:
            number = damaged.number if isinstance(damaged, JournalDamaged) else None
            yield Problem(damaged.problem.removeprefix(f"{path}: "), number)
    for rule in database.missing_rules(connection):
        yield Problem(f"the rule '{rule}' has been taken out of the file")


def _entries(rows: Sequence[Row]) -> tuple[list[Entry[Record]], list[Problem]]:
    entries: list[Entry[Record]] = []
    problems: list[Problem] = []
    for number, at_utc, kind, series, _, _, body, _ in rows:
        try:
            entries.append(Entry(number, at_utc, series, from_text(kind, body)))
        except ValueError as error:
            problems.append(Problem(f"record {number} cannot be read: {error}", number))
    return entries, problems


def _said_otherwise(
    readers: RawReaders, measured: Outcome, controller: str, tracker: str
) -> Iterator[str]:
    """Where a measurement is not what the raw answers beside it say."""
    try:
        joints = readers[0](controller, measured.raw_robot)
        point_mm, covariance = readers[1](tracker, measured.raw_tracker)
    except DriverError as error:
        yield f"a raw answer cannot be read: {error.problem}"
        return
    if not _same(measured.joints, joints):
        yield f"joints {measured.joints}, the raw answer says {joints}"
    if not _same(measured.point_in_tracker_mm, point_mm):
        yield f"point {measured.point_in_tracker_mm} mm, the raw answer says {point_mm}"
    if covariance is not None and not _same(_flat(measured.covariance_mm2), _flat(covariance)):
        yield f"covariance {measured.covariance_mm2} mm², the raw answer says {covariance}"


def _measured(record: Record) -> Outcome | None:
    if isinstance(record, Rejected):
        return record.measured
    return record if isinstance(record, Outcome) else None


def _drivers(started: SeriesStarted) -> tuple[str, str]:
    """Drivers of controller and tracker; "" where a series does not say, or has no devices."""
    configuration = {} if started.imported else started.configuration
    sections = (configuration.get("controller"), configuration.get("tracker"))
    controller, tracker = (
        str(each.get("driver", "")) if isinstance(each, dict) else "" for each in sections
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
