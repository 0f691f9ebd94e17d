"""From a campaign's folder to the evidence that a report is made of. Only reads."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from app.folder import Campaign
from app.report.evidence import Evidence, Incident, JournalFacts, MeasuredSeries, SeriesFacts
from app.report.findings import (
    IdentificationFinding,
    LoadFinding,
    UnreadableFinding,
    read_identification,
    read_load,
)
from campaigns.controllers.export import FILE_NAME as PARAMETER_FILE
from campaigns.errors import CampaignError
from campaigns.journal.journal import JournalReader, read_journal
from campaigns.journal.records import (
    Event,
    Finding,
    FindingKind,
    PairVoided,
    Record,
    Rejected,
    SessionStarted,
    Stage,
)
from campaigns.journal.views import Entry, Series, accepted_shots, unstopped_sessions
from campaigns.planning.plan_file import PlannedShot, read_plan
from campaigns.robots.robot import RobotFile, read_robot
from campaigns.shots.shots import shots_of_journal

FoundT = TypeVar("FoundT", IdentificationFinding, LoadFinding)
FileT = TypeVar("FileT")


def collect(campaign: Campaign) -> Evidence:
    """Read everything that is there; raises `JournalFailed` for a journal that cannot be read."""
    unreadable: list[str] = []
    plan = _read_file(campaign.plan_path, read_plan, unreadable)
    parameters = _read_file(campaign.path(PARAMETER_FILE), _robot, unreadable)
    if not campaign.journal_path.exists():
        return _without_journal(campaign, plan, parameters, unreadable)
    with read_journal(campaign.journal_path) as journal:
        return _with_journal(campaign, journal, plan, parameters, unreadable)


def _without_journal(
    campaign: Campaign,
    plan: tuple[PlannedShot, ...] | None,
    parameters: RobotFile | None,
    unreadable: list[str],
) -> Evidence:
    nothing = (None, None, None, None, None, None)
    return Evidence(campaign, *nothing, plan, parameters, tuple(unreadable))


def _with_journal(
    campaign: Campaign,
    journal: JournalReader,
    plan: tuple[PlannedShot, ...] | None,
    parameters: RobotFile | None,
    unreadable: list[str],
) -> Evidence:
    entries = journal.records()
    all_series = journal.series()
    identification = _latest(entries, "identification", read_identification, unreadable)
    return Evidence(
        campaign,
        _facts(journal, entries, all_series, identification),
        _measured(entries, _chosen(all_series, {"before"})),
        _measured(entries, _identified_series(all_series, identification)),
        _measured(entries, _chosen(all_series, {"after"})),
        identification,
        _latest(entries, "load", read_load, unreadable),
        plan,
        parameters,
        tuple(unreadable),
    )


def _read_file(path: Path, read: Callable[[Path], FileT], unreadable: list[str]) -> FileT | None:
    if not path.exists():
        return None
    try:
        return read(path)
    except CampaignError as error:
        unreadable.append(error.problem)
        return None


def _robot(path: Path) -> RobotFile:
    return read_robot(path).robot


def _latest(
    entries: Iterable[Entry[Record]],
    kind: FindingKind,
    read: Callable[..., FoundT],
    unreadable: list[str],
) -> FoundT | None:
    """The last finding of a kind."""
    found = [
        (entry.number, entry.record.body)
        for entry in entries
        if isinstance(entry.record, Finding) and entry.record.kind == kind
    ]
    if not found:
        return None
    number, body = found[-1]
    try:
        return read(body)
    except UnreadableFinding as error:
        unreadable.append(f"the journal's record {number} ({kind}): {error}")
        return None


def _chosen(all_series: Iterable[Series], stages: set[Stage]) -> Series | None:
    """The last finished series of these stages, or the last one begun when none is finished."""
    of_stage = [series for series in all_series if series.started.stage in stages]
    finished = [series for series in of_stage if series.finished]
    return next(iter([*reversed(finished), *reversed(of_stage)]), None)


def _identified_series(
    all_series: tuple[Series, ...], identification: IdentificationFinding | None
) -> Series | None:
    """The series that the identification rests on, or the one that the next would rest on."""
    if identification is None:
        return _chosen(all_series, {"run", "import"})
    return next((s for s in all_series if s.number == identification.series), None)


def _measured(entries: Iterable[Entry[Record]], series: Series | None) -> MeasuredSeries | None:
    if series is None:
        return None
    shots = accepted_shots(entry for entry in entries if entry.series == series.number)
    return MeasuredSeries(series, shots, shots_of_journal(shots)) if shots else None


def _facts(
    journal: JournalReader,
    entries: tuple[Entry[Record], ...],
    all_series: tuple[Series, ...],
    identification: IdentificationFinding | None,
) -> JournalFacts:
    through = identification.journal_records if identification else None
    return JournalFacts(
        tuple(_series_facts(entries, series) for series in all_series),
        tuple(
            Incident(entry.at_utc, entry.series, entry.record)
            for entry in entries
            if isinstance(entry.record, Rejected | PairVoided | Event)
        ),
        journal.digest(),
        journal.last_number(),
        None if through is None else journal.digest(through=through),
    )


def _series_facts(entries: Iterable[Entry[Record]], series: Series) -> SeriesFacts:
    own = [entry for entry in entries if entry.series == series.number]
    sessions = sum(isinstance(entry.record, SessionStarted) for entry in own)
    return SeriesFacts(series, len(accepted_shots(own)), sessions, len(unstopped_sessions(own)))
