"""Views of a journal, read off its records in their order. Pure."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Generic, TypeVar

from campaigns.journal.records import (
    Intent,
    Outcome,
    PairVoided,
    Record,
    Rejected,
    SeriesFinished,
    SeriesStarted,
    SessionStarted,
    SessionStopped,
    Stage,
)

RecordT = TypeVar("RecordT", bound=Record, covariant=True)


@dataclass(frozen=True, slots=True)
class Entry(Generic[RecordT]):
    """A record in its place. `series` is None for what belongs to the campaign as a whole."""

    number: int
    at_utc: str
    series: int | None
    record: RecordT


@dataclass(frozen=True, slots=True)
class Series:
    """A series as it stands."""

    number: int
    started_utc: str
    started: SeriesStarted
    finished: bool


@dataclass(frozen=True, slots=True)
class AcceptedShot:
    """Accepted shot: what was asked for and what came of it."""

    intent: Intent
    outcome: Outcome
    measured_utc: str
    number: int = 0
    """Place of the outcome in the journal, which is the order of time whatever the clock was set
    to; 0 of one that is in none."""


def series_of_stage(entries: Iterable[Entry[Record]], stage: Stage | None) -> tuple[Series, ...]:
    """Return the series of one stage, or of all, in the order of their beginning."""
    begun: list[tuple[int, Entry[Record], SeriesStarted]] = []
    finished: set[int] = set()
    for entry in entries:
        if entry.series is None:
            continue
        if isinstance(entry.record, SeriesStarted) and stage in (None, entry.record.stage):
            begun.append((entry.series, entry, entry.record))
        if isinstance(entry.record, SeriesFinished):
            finished.add(entry.series)
    return tuple(
        Series(number, entry.at_utc, started, number in finished)
        for number, entry, started in begun
    )


def accepted_shots(entries: Iterable[Entry[Record]]) -> tuple[AcceptedShot, ...]:
    """Return each shot's latest accepted outcome that was not voided since, by shot number.

    `entries` are those of one series.
    """
    intents: dict[tuple[int, int], Intent] = {}
    accepted: dict[int, AcceptedShot] = {}
    for entry in entries:
        match entry.record:
            case Intent() as intent:
                intents[intent.shot, intent.attempt] = intent
            case Outcome() as outcome:
                intent = intents[outcome.shot, outcome.attempt]
                accepted[outcome.shot] = AcceptedShot(intent, outcome, entry.at_utc, entry.number)
            case PairVoided() as voided:
                for shot in voided.shots:
                    accepted.pop(shot, None)
    return tuple(accepted[shot] for shot in sorted(accepted))


def unanswered_intents(entries: Iterable[Entry[Record]]) -> tuple[Intent, ...]:
    """Return the intents of one series that have neither outcome nor rejection."""
    waiting: dict[tuple[int, int], Intent] = {}
    for entry in entries:
        match entry.record:
            case Intent() as intent:
                waiting[intent.shot, intent.attempt] = intent
            case Outcome() | Rejected() as ended:
                waiting.pop((ended.shot, ended.attempt), None)
    return tuple(waiting.values())


def unstopped_sessions(entries: Iterable[Entry[Record]]) -> tuple[Entry[SessionStarted], ...]:
    """Return the sessions without a stop before the next session or the journal's end."""
    unstopped: list[Entry[SessionStarted]] = []
    running: Entry[SessionStarted] | None = None
    for entry in entries:
        match entry.record:
            case SessionStarted() as started:
                if running:
                    unstopped.append(running)
                running = Entry(entry.number, entry.at_utc, entry.series, started)
            case SessionStopped():
                running = None
    return (*unstopped, running) if running else tuple(unstopped)
