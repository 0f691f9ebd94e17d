"""Series of a journal with their shots. Pure."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Generic, TypeVar

from campaigns.journal import records

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


_Parts = dict[
    int | None,
    tuple[
        Entry[records.Record],
        Counter[type[records.Record]],
        dict[tuple[int, int], records.Intent],
        dict[int, AcceptedShot],
    ],
]
"""By series: its first record, how many there are of each kind, intents by shot and attempt, and
accepted shots."""


def all_series(entries: Iterable[Entry[records.Record]]) -> tuple[Series, ...]:
    """Return all series, in the order of their beginning.

    An outcome without its intent, in a damaged journal, does not count.
    """
    parts: _Parts = {}
    for entry in entries:
        if entry.series not in parts:
            parts[entry.series] = entry, Counter(), {}, {}
        _, kinds, intents, accepted = parts[entry.series]
        kinds[type(entry.record)] += 1
        match entry.record:
            case records.Intent() as intent:
                intents[intent.shot, intent.attempt] = intent
            case records.Outcome(shot=shot, attempt=attempt) as outcome if (
                shot,
                attempt,
            ) in intents:
                intent = intents[shot, attempt]
                accepted[shot] = AcceptedShot(
                    intent, outcome, entry.at_utc, entry.number, kinds[records.SessionStarted]
                )
            case records.PairVoided() as voided:
                for shot in voided.shots:
                    accepted.pop(shot, None)
    return tuple(
        Series(
            number,
            first.at_utc,
            first.record,
            finished=kinds[records.SeriesFinished] > 0,
            shots=tuple(accepted[shot] for shot in sorted(accepted)),
            sessions=kinds[records.SessionStarted],
            unstopped=kinds[records.SessionStarted] - kinds[records.SessionStopped],
        )
        for number, (first, kinds, _, accepted) in parts.items()
        if number is not None and isinstance(first.record, records.SeriesStarted)
    )
