"""What a report rests on, as one value: everything that the campaign's folder holds."""

from dataclasses import dataclass
from typing import Literal

from app.folder import Campaign
from app.report.findings import IdentificationFinding, LoadFinding
from campaigns.journal.records import Event, PairVoided, Rejected
from campaigns.journal.views import AcceptedShot, Series
from campaigns.planning.plan_file import PlannedShot
from campaigns.robots.robot import RobotFile
from campaigns.shots.shots import Shots
from drivers.values import Identity

IncidentKind = Literal["rejected", "pair voided", "event"]


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredSeries:
    """A series and its accepted shots."""

    series: Series
    shots: tuple[AcceptedShot, ...]
    data: Shots


@dataclass(frozen=True, slots=True)
class SeriesFacts:
    """A line of the list of series."""

    series: Series
    accepted: int
    sessions: int
    unstopped: int
    """Sessions that neither finished nor stopped in order: a crash, or still at work."""

    @property
    def robot(self) -> Identity | None:
        """Who answered as controller."""
        return self.series.started.robot

    @property
    def tracker(self) -> Identity | None:
        """Who answered as tracker."""
        return self.series.started.tracker


@dataclass(frozen=True, slots=True)
class Incident:
    """Something that went otherwise than planned, or that the operator should know."""

    at_utc: str
    series: int | None
    record: Rejected | PairVoided | Event

    @property
    def kind(self) -> IncidentKind:
        """What sort of thing it is."""
        match self.record:
            case Rejected():
                return "rejected"
            case PairVoided():
                return "pair voided"
            case Event():
                return "event"

    @property
    def concerns(self) -> str:
        """The shot and attempt, or the pair."""
        match self.record:
            case Rejected(shot=shot, attempt=attempt):
                return f"shot {shot}, attempt {attempt}"
            case PairVoided(pair=pair, shots=shots):
                return f"pair {pair}, shots {', '.join(map(str, shots))}"
            case Event(kind=kind):
                return kind

    @property
    def text(self) -> str:
        """Why, in the words of the journal."""
        record = self.record
        return record.text if isinstance(record, Event) else record.reason


@dataclass(frozen=True, slots=True)
class JournalFacts:
    """What the journal says besides shots and findings."""

    series: tuple[SeriesFacts, ...]
    incidents: tuple[Incident, ...]
    digest: str
    records: int
    identified_digest: str | None
    """Of the records up to where the identification was made, as they are now."""


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Everything that a report is made of. None: it is not there."""

    campaign: Campaign
    journal: JournalFacts | None
    before: MeasuredSeries | None
    run: MeasuredSeries | None
    after: MeasuredSeries | None
    identification: IdentificationFinding | None
    loaded: LoadFinding | None
    plan: tuple[PlannedShot, ...] | None
    parameter_file: RobotFile | None
    unreadable: tuple[str, ...]
    """What is there and cannot be read, and why."""

    def by_stage(self) -> tuple[tuple[str, MeasuredSeries], ...]:
        """The series that are there, in the order in which a campaign measures them."""
        named = (("before", self.before), ("run", self.run), ("after", self.after))
        return tuple((name, measured) for name, measured in named if measured is not None)
