"""Series of a journal with their shots, computed from its records. Pure.

Nothing of this is stored: what counts now follows from the records alone, so that it cannot
contradict them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from campaigns.journal import records
from campaigns.journal.database import StoredRecord

FIXED = {"known-length", "nest"}
"""Purposes of shots that do not measure the robot: calibrated lengths, fixed places."""
RecordT = TypeVar("RecordT", bound=records.Record, covariant=True)


@dataclass(frozen=True, slots=True)
class Entry(Generic[RecordT]):
    """A record in its place. `series` is None for what belongs to the campaign as a whole."""

    number: int
    at_utc: str
    series: int | None
    record: RecordT


def entry_of(stored: StoredRecord) -> Entry[records.Record]:
    """Return a stored row as a record; raise `ValueError` if it cannot be read."""
    try:
        record = records.from_text(stored.kind, stored.body)
    except ValueError as error:
        raise ValueError(f"record {stored.number} cannot be read: {error}") from error
    # The file's rules compare the columns, and `all_series` the bodies: both have to agree.
    for column, value in (("shot", stored.shot), ("attempt", stored.attempt)):
        if getattr(record, column, None) != value:
            raise ValueError(f"record {stored.number} cannot be read: {column} is not {value}")
    return Entry(stored.number, stored.at_utc, stored.series, record)


@dataclass(frozen=True, slots=True)
class AcceptedShot:
    """Accepted shot: the intent and its outcome."""

    intent: records.Intent
    outcome: records.Outcome
    measured_utc: str
    number: int = 0
    """Place of the outcome in the journal; 0 for a shot outside a journal.

    It is the order of time, which stamps are not: the clock may have been set back.
    """
    session: int = 0
    """Number, from 1, of the session of the series that measured the shot; 0 without sessions."""


@dataclass(frozen=True, slots=True)
class Series:
    """A series as it stands."""

    number: int
    started_utc: str
    started: records.SeriesStarted
    finished: bool
    shots: tuple[AcceptedShot, ...] = ()
    """Each shot's latest accepted outcome that was not voided since, by shot number."""
    sessions: int = 0
    unstopped: int = 0
    """Sessions that wrote no end: those that crashed, and one that is going on."""

    @property
    def of_known_lengths(self) -> bool:
        """Return whether nothing but known lengths and nests was measured."""
        return bool(self.shots) and all(shot.intent.purpose in FIXED for shot in self.shots)

    @property
    def to_identify(self) -> bool:
        """Return whether a robot can be identified from the series.

        A run may be unfinished; an import must not have broken off.
        """
        imported = self.started.stage == "import" and self.finished
        of_run = imported or self.started.stage == "run"
        return of_run and bool(self.shots) and not self.of_known_lengths


def all_series(entries: Iterable[Entry[records.Record]]) -> tuple[Series, ...]:
    """Return all series, in the order of their beginning."""
    of_series: dict[int, list[Entry[records.Record]]] = {}
    for entry in entries:
        if entry.series is not None:
            of_series.setdefault(entry.series, []).append(entry)
    return tuple(_make_series(number, of_one) for number, of_one in of_series.items())


def _make_series(number: int, entries: Sequence[Entry[records.Record]]) -> Series:
    """Put a series together from its records, of which the first is its start."""
    # One pass in the order of time, so that a later record overrides an earlier one: an outcome
    # replaces the shot's outcome before, a voiding removes it, and the outcome after that counts
    # again.
    first = entries[0]
    assert isinstance(first.record, records.SeriesStarted), "verified by the file's rules"
    intents: dict[tuple[int, int], records.Intent] = {}
    accepted: dict[int, AcceptedShot] = {}
    sessions, stops, finished = 0, 0, False
    for entry in entries:
        match entry.record:
            case records.SessionStarted():
                sessions += 1
            case records.SessionStopped():
                stops += 1
            case records.SeriesFinished():
                finished = True
            case records.Intent() as intent:
                intents[intent.shot, intent.attempt] = intent
            case records.Outcome() as outcome:
                intent = intents[outcome.shot, outcome.attempt]  # a rule demands it
                accepted[outcome.shot] = AcceptedShot(
                    intent, outcome, entry.at_utc, entry.number, sessions
                )
            case records.PairVoided() as voided:
                for shot in voided.shots:
                    accepted.pop(shot, None)
    shots = tuple(accepted[shot] for shot in sorted(accepted))
    return Series(
        number, first.at_utc, first.record, finished, shots, sessions, unstopped=sessions - stops
    )
