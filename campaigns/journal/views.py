"""Series of a journal with their shots. Pure."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from campaigns.journal import records
from campaigns.journal.database import StoredRecord

FIXED = {"known-length", "nest"}
"""Sets of shots without the robot: at calibrated lengths, at fixed places."""
RecordT = TypeVar("RecordT", bound=records.Record, covariant=True)


@dataclass(frozen=True, slots=True)
class Entry(Generic[RecordT]):
    """A record in its place. `series` is None for what belongs to the campaign as a whole."""

    number: int
    at_utc: str
    series: int | None
    record: RecordT


def entry_of(stored: StoredRecord) -> Entry[records.Record]:
    """Return the record that is stored; raises `ValueError` if it cannot be read."""
    try:
        record = records.from_text(stored.kind, stored.body)
    except ValueError as error:
        raise ValueError(f"record {stored.number} cannot be read: {error}") from error
    return Entry(stored.number, stored.at_utc, stored.series, record)


@dataclass(frozen=True, slots=True)
class AcceptedShot:
    """Accepted shot: what was asked for and what came of it."""

    intent: records.Intent
    outcome: records.Outcome
    measured_utc: str
    number: int = 0
    """Place of the outcome in the journal, which is the order of time whatever the clock was set
    to; 0 of one that is in none."""
    session: int = 0
    """Which session of its series it was measured in, from 1; 0 where none was begun."""


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
    """Sessions without a stop before the next session or the journal's end."""

    @property
    def of_known_lengths(self) -> bool:
        """Whether nothing but known lengths and nests was measured."""
        return bool(self.shots) and all(each.intent.purpose in FIXED for each in self.shots)

    @property
    def to_identify(self) -> bool:
        """Whether a robot can be identified from it: of an import, if it did not break off."""
        imported = self.started.stage == "import" and self.finished
        of_run = imported or self.started.stage == "run"
        return of_run and bool(self.shots) and not self.of_known_lengths


def all_series(entries: Iterable[Entry[records.Record]]) -> tuple[Series, ...]:
    """Return all series, in the order of their beginning."""
    of_series: dict[int, list[Entry[records.Record]]] = {}
    for entry in entries:
        if entry.series is not None:
            of_series.setdefault(entry.series, []).append(entry)
    return tuple(_series(number, of_one) for number, of_one in of_series.items())


def _series(number: int, entries: Sequence[Entry[records.Record]]) -> Series:
    """Put a series together from its records, of which the first is its start."""
    first = entries[0]
    assert isinstance(first.record, records.SeriesStarted), "the file takes no other first record"
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
                intent = intents[outcome.shot, outcome.attempt]
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
