"""Evidence: everything that a campaign's folder holds, as one value."""

# `gather` reads the folder once and writes nothing: settings, plan.csv, the exported robot file and
# the journal become one immutable value, `Evidence`. What is missing is None or empty. What is
# there and cannot be read becomes a sentence in `unreadable`, so that one spoilt file hides
# nothing else; only a journal that cannot be read is an error.

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Literal, TypeVar

from pydantic import JsonValue

from campaigns.campaign import Campaign
from campaigns.controllers.controller_state import ControllerState, KnownSets
from campaigns.controllers.export import FILE_NAME as PARAMETER_FILE
from campaigns.controllers.export import PLAIN, WrittenSet, written_sets
from campaigns.controllers.load_journal import Load, load_history, read_load
from campaigns.errors import CampaignError, FindingUnreadable, OutputExists, PlanInvalid
from campaigns.evaluation.simulated_devices import OWN_EQUATIONS, simulated_devices
from campaigns.files.text_file import head_of
from campaigns.identification.checking import RecordedCheck, read_check
from campaigns.identification.result import RecordedIdentification, read_identification
from campaigns.journal.journal import JournalReader
from campaigns.journal.records import Event, Finding, FindingKind, PairVoided, Rejected, Stage
from campaigns.journal.views import Series
from campaigns.kinematics.catalog import MECHANISMS
from campaigns.kinematics.mechanism import Mechanism
from campaigns.planning.plan_file import (
    PlannedShot,
    older_plans,
    plan_digest,
    read_options,
    read_plan,
)
from campaigns.robots.robot import RobotFile, read_robot
from campaigns.settings.instrument import NamedInstruments
from campaigns.shots.observation_records import (
    NO_OBSERVATIONS,
    RecordedObservations,
    recorded_observations,
)
from campaigns.shots.observations_csv import FILE_NAME as OBSERVATIONS
from campaigns.shots.observations_csv import read_observations
from campaigns.shots.shots import Shots, shots_of_journal
from campaigns.shots.stops import by_stops
from drivers.bounded_files import is_file, is_there
from drivers.texts import quoted

FoundT = TypeVar("FoundT")
REPORT_FILE = "report.html"
"""Name of the report in a campaign's folder."""
STAGES: Mapping[Literal["before", "after"], frozenset[Stage]] = {
    "before": frozenset({"before"}),
    "after": frozenset({"after", "after by targets"}),
}
"""Stages of the journal's series, by the stage of the validation that they belong to."""


@dataclass(frozen=True, eq=False)
class MeasuredSeries:
    """Series with its accepted shots as arrays, made at first use."""

    series: Series
    mechanism: Mechanism

    @cached_property
    def shots(self) -> Shots:
        """Accepted shots of the series."""
        return shots_of_journal(self.series.shots, self.mechanism)

    @cached_property
    def stops(self) -> Shots:
        """Accepted shots of the series, the samples of each stop averaged."""
        return by_stops(self.shots, self.mechanism.joints)


@dataclass(frozen=True, slots=True)
class Incident:
    """Deviation from the plan, or an event that the operator should know of."""

    at_utc: str
    series: int | None
    record: Rejected | PairVoided | Event

    @property
    def concerns(self) -> str:
        """Shot and attempt, or pair, or kind of event that the incident is about."""
        match self.record:
            case Rejected(shot=shot, attempt=attempt):
                return f"shot {shot}, attempt {attempt}"
            case PairVoided(pair=None, shots=shots):
                return f"shot {', '.join(map(str, shots))}"
            case PairVoided(pair=pair, shots=shots):
                return f"pair {pair}, shots {', '.join(map(str, shots))}"
            case Event(kind=kind):
                return kind

    @property
    def text(self) -> str:
        """Reason in the words of the journal."""
        record = self.record
        return record.text if isinstance(record, Event) else record.reason


@dataclass(frozen=True, slots=True)
class JournalFacts:
    """Contents of the journal besides shots and findings."""

    series: tuple[Series, ...]
    """All series, in the order of their beginning."""
    incidents: tuple[Incident, ...]
    records: int
    """Number of records."""
    digest: str
    """Digest of all records."""
    identified_digest: str | None
    """Digest of the records up to the identification, as they are now; None without one."""
    unended_load: str = ""
    """Sentence about a load that was begun and not ended; empty if there is none."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """Everything read from a campaign's folder.

    A field is None or empty if the campaign has not got that far.
    """

    campaign: Campaign
    journal: JournalFacts | None = None
    before: tuple[MeasuredSeries, ...] = ()
    """Series of the validation before calibration, oldest first."""
    run: MeasuredSeries | None = None
    """Series that was identified from, or that the next identification would use."""
    after: tuple[MeasuredSeries, ...] = ()
    """Series of the validation after calibration, oldest first."""
    observations: RecordedObservations = NO_OBSERVATIONS
    """Observations of other kinds than points, imported or measured by a run."""
    plans_observations: bool = False
    """Whether observations.csv has rows without a value."""
    identification: RecordedIdentification | None = None
    """Latest identification."""
    loaded: Load | None = None
    """Latest load that took effect."""
    checked: RecordedCheck | None = None
    """Latest check."""
    plan: tuple[PlannedShot, ...] | None = None
    """Shots of plan.csv."""
    plan_options: tuple[str, ...] = ()
    """Options that plan.csv was made with, as words."""
    older_plans: Mapping[str, str] = field(default_factory=dict)
    """Names of the older plans that are kept beside plan.csv, by their digests."""
    parameter_file: RobotFile | None = None
    """Exported robot file in the campaign's folder."""
    spoilt_parameter_file: bool = False
    """Whether the exported robot file is there and cannot be read."""
    sets: KnownSets | None = None
    """Parameter sets in the journal."""
    written: WrittenSet | None = None
    """Set with which `export` or `correct` wrote a file last."""
    forms: tuple[WrittenSet, ...] = ()
    """Forms of identified sets that are robot files in the campaign's folder, latest first."""
    program_after: bool = False
    """Whether there is a program for the validation after calibration with `written`."""
    unreadable: tuple[str, ...] = ()
    """Problems of files and records that are there and cannot be read."""

    @cached_property
    def plan_digest(self) -> str | None:
        """Digest of plan.csv; None without a plan."""
        mechanism = self.campaign.robot.mechanism
        return None if self.plan is None else plan_digest(self.plan, mechanism)

    @property
    def has_program(self) -> bool:
        """Whether there is a program of plan.csv."""
        digest = self.plan_digest
        return digest is not None and is_program_there(self.campaign.folder, "run", digest)

    def state(self, digest: str | None) -> ControllerState | None:
        """Return the state of a controller with the set of this digest; None if unknown."""
        return self.sets.state(digest) if self.sets and digest else None

    def held(self, stage: Literal["before", "after"]) -> ControllerState | None:
        """Return the state of the controller in a stage; None if the stage was not validated."""
        measured = self.before if stage == "before" else self.after
        if not measured:
            return None
        # all series of a stage have the parameters of the last one (see `counted_series`)
        started = measured[-1].series.started
        state, targets = self.state(started.robot_file_digest), started.stage == "after by targets"
        return state and replace(state, targets=targets, declared=started.declared)

    @property
    def file_origin(self) -> str | None:
        """Digest of the set that the parameter file holds, or whose form it holds; None without."""
        if self.parameter_file is None:
            return None
        digest = self.parameter_file.digest()
        state = self.state(digest)
        return state.origin if state and state.origin else digest

    @property
    def loaded_since(self) -> bool:
        """Whether the controller was given another set since the validation after calibration."""
        # A declared set was never read, so that a load cannot be compared with it. By corrected
        # targets the controller held the nominal set, while `after.digest` is the correcting one.
        after, loaded = self.held("after"), self.loaded
        if after is None or after.declared or loaded is None or self.sets is None:
            return False
        held = self.campaign.robot.digest() if after.targets else after.digest
        return self._is_loaded_later and not self.sets.are_one(loaded.digest, held)

    @property
    def _is_loaded_later(self) -> bool:
        """Whether the last load ended after the last validation began."""
        if self.loaded is None or not self.loaded.at_utc:
            return False
        started = self.after[-1].series.started_utc
        return datetime.fromisoformat(self.loaded.at_utc) > datetime.fromisoformat(started)

    @property
    def controller(self) -> ControllerState | None:
        """State of the controller by the latest load or validation, whichever is later.

        None without either. A validation counts only if it read the controller's parameters.
        """
        after = self.held("after")
        if after is None or after.declared or after.targets or self._is_loaded_later:
            return self.state(self.loaded.digest if self.loaded else None)
        return after

    @property
    def unanswered(self) -> RecordedCheck | None:
        """Latest check if it did not pass and no new shots to identify from followed; else None."""
        check, identification = self.checked, self.identification
        if check is None or identification is None or check.decision == "pass":
            return None
        series = self.journal.series if self.journal else ()
        is_followed = any(each.number > check.series and each.to_identify for each in series)
        return None if is_followed else check

    @property
    def warnings(self) -> tuple[str, ...]:
        """Latest event of each kind in which a series itself gives reason to doubt.

        Of the series that was identified from, and of those that validate the result.
        """
        judged = [*([self.run] if self.run else []), *self.after]
        numbers = {measured.series.number for measured in judged}
        latest = {
            (incident.series, incident.record.kind): incident.record
            for incident in (self.journal.incidents if self.journal else ())
            if isinstance(incident.record, Event) and incident.series in numbers
        }
        # The shots of "settling" are those since which the robot stays: without any it still moves.
        return tuple(
            event.text
            for (_, kind), event in latest.items()
            if kind in {"robot changed", "temperature alarm"}
            or (kind == "settling" and not event.shots)
        )

    @property
    def simulated(self) -> str:
        """Sentence on simulated devices, by each series or by campaign.yaml; "" if all are real."""
        series = self.journal.series if self.journal else ()
        devices = simulated_devices(series, planned=self.campaign.is_simulated)
        has_parts = self.campaign.robot.mechanism.name in MECHANISMS
        return devices if has_parts or not devices else f"{devices} {OWN_EQUATIONS}"

    @cached_property
    def named_instruments(self) -> NamedInstruments:
        """Names of the instruments as the latest series recorded them, or else of campaign.yaml."""
        config = self.campaign.config
        now = NamedInstruments.of(config.tracker, config.instruments)
        latest = [item.series.started for _, item in self.by_stage()][-1:]
        return now.recorded(latest[0]) if latest else now

    def counted(self) -> tuple[MeasuredSeries, ...]:
        """Return the series on which the verdict rests: in each stage of each set the latest."""
        counted: list[MeasuredSeries] = []
        for of_stage in (self.before, () if self.run is None else (self.run,), self.after):
            latest = {shot.intent.purpose: item for item in of_stage for shot in item.series.shots}
            counted += [item for item in of_stage if item in latest.values()]
        return tuple(counted)

    def by_stage(self) -> tuple[tuple[str, MeasuredSeries], ...]:
        """Return the names of all series with their shots, in the order of a campaign."""
        run = () if self.run is None else (self.run,)
        stages = (("before", self.before), ("run", run), ("after", self.after))
        return tuple(
            (name if len(all_of_stage) == 1 else f"{name}, series {item.series.number}", item)
            for name, all_of_stage in stages
            for item in all_of_stage
        )


def program_path(folder: Path, stage: str) -> Path:
    """Return the file of a stage's program for a controller out of reach."""
    return folder / f"program-{stage}.csv"


def joints_path(folder: Path, stage: str) -> Path:
    """Return the file of the joints of a stage's shots, for `import`."""
    return folder / f"program-{stage}-joints.csv"


def refuse_other_report(path: Path) -> None:
    """Raise `OutputExists` for a file at a report's place that is no report."""
    if is_there(path) and b'name="generator" content="pkmcal' not in head_of(path):
        raise OutputExists(
            f"{path} already exists and is no report", remedy="name another, or move this one away"
        )


def is_program_there(folder: Path, stage: str, digest: str) -> bool:
    """Return whether a stage's program names this digest in its heading."""
    path = program_path(folder, stage)
    if not is_file(path):
        return False
    with path.open("rb") as file:
        return digest.encode() in file.read(4000)  # the heading stands in the first row


def gather(campaign: Campaign) -> Evidence:
    """Read everything in a campaign's folder.

    Raise `JournalFailed` for a journal that cannot be read.
    """
    unreadable: list[str] = []
    path = campaign.path(PARAMETER_FILE)
    parameters = _read_if_there(path, lambda path: read_robot(path).robot, unreadable)
    mechanism = campaign.robot.mechanism
    rows = _read_if_there(
        campaign.path(OBSERVATIONS), lambda path: read_observations(path, mechanism), unreadable
    )
    files = Evidence(
        campaign=campaign,
        plan=_read_if_there(campaign.plan_path, lambda _: campaign.read_plan(), unreadable),
        plan_options=read_options(campaign.plan_path, mechanism),
        older_plans=_older_plans(campaign),
        plans_observations=any(row.is_planned for row in rows or ()),
        parameter_file=parameters,
        spoilt_parameter_file=parameters is None and path.exists(),
        unreadable=tuple(unreadable),
    )
    if not campaign.journal_path.exists():
        return files
    with campaign.journal_reader() as journal:
        return _with_journal(files, journal)


def _older_plans(campaign: Campaign) -> dict[str, str]:
    """Return the names of older plans by their digests; those that cannot be read are left out."""
    mechanism, names = campaign.robot.mechanism, dict[str, str]()
    for path in older_plans(campaign.plan_path):
        with suppress(PlanInvalid):
            names[plan_digest(read_plan(path, mechanism), mechanism)] = path.name
    return names


def _with_journal(files: Evidence, journal: JournalReader) -> Evidence:
    """Return the evidence of the files completed by the journal."""
    campaign, unreadable = files.campaign, [*files.unreadable]
    entries, all_series = journal.records(), journal.series()
    identification = _latest(journal, "identification", read_identification, unreadable)
    observations = NO_OBSERVATIONS
    try:
        observations = recorded_observations(journal)
    except FindingUnreadable as error:
        unreadable.append(error.problem)
    loaded = _latest(journal, "load", read_load, unreadable)
    if loaded is not None:
        loaded = replace(loaded, at_utc=journal.findings("load")[-1].at_utc)
    incidents = tuple(
        Incident(entry.at_utc, entry.series, entry.record)
        for entry in entries
        if isinstance(entry.record, Rejected | PairVoided | Event)
    )
    identified_digest = None
    if identification is not None:
        # Records may have come since; those up to the identification must be as they were. A
        # journal that lost records is compared as far as it goes, and then differs.
        through = min(identification.provenance.journal_records, journal.last_number())
        identified_digest = journal.digest(through=through)
    run = _measured(campaign, _identified_series(all_series, identification))
    findings = [entry.record for entry in entries if isinstance(entry.record, Finding)]
    all_written = tuple(written_sets(journal))
    written = next(iter(all_written), None)
    return replace(
        files,
        journal=JournalFacts(
            series=all_series,
            incidents=incidents,
            records=journal.last_number(),
            digest=journal.digest(),
            identified_digest=identified_digest,
            unended_load=unended_load(journal, unreadable).replace(
                "DIR", quoted(str(campaign.folder))
            ),
        ),
        before=_measured(campaign, counted_series(all_series, "before")),
        run=run[0] if run else None,
        after=_measured(campaign, counted_series(all_series, "after")),
        observations=observations,
        identification=identification,
        loaded=loaded,
        checked=_latest(journal, "check", read_check, unreadable),
        sets=KnownSets.of(campaign.robot, findings),
        written=written,
        forms=tuple(_existing_forms(campaign, all_written)),
        program_after=written is not None
        and is_program_there(campaign.folder, "after", written.digest),
        unreadable=tuple(unreadable),
    )


def _existing_forms(campaign: Campaign, written: Iterable[WrittenSet]) -> Iterator[WrittenSet]:
    """Yield the plain sets that are robot files in the folder, latest first.

    `written` are all written sets, latest first: the first one of a name is what its file holds.
    """
    names = set[str]()
    for export in written:
        if export.file not in names and campaign.path(export.file).exists():
            names.add(export.file)
            if export.projection and export.projection.name == PLAIN:
                yield export


def _read_if_there(
    path: Path, read: Callable[[Path], FoundT], unreadable: list[str]
) -> FoundT | None:
    """Read a file; return None without it, or if it cannot be read, which `unreadable` states."""
    if not path.exists():
        return None
    try:
        return read(path)
    except CampaignError as error:
        unreadable.append(error.problem)
        return None


def _latest(
    journal: JournalReader,
    kind: FindingKind,
    read: Callable[[Mapping[str, JsonValue]], FoundT],
    unreadable: list[str],
) -> FoundT | None:
    """Read the last finding of a kind; return None without one, or if it cannot be read.

    No earlier finding takes the place of an unreadable one: it would be out of date.
    """
    for entry in journal.findings(kind)[-1:]:
        try:
            return read(entry.record.body)
        except FindingUnreadable as error:
            unreadable.append(f"record {entry.number}: {error.problem}")
    return None


def unended_load(journal: JournalReader, unreadable: list[str]) -> str:
    """Return a sentence about a load without an end; "" if there is none."""
    try:
        _, unended = load_history(journal)
    except FindingUnreadable as error:
        unreadable.append(error.problem)
        return "a load was begun in a form that this version cannot read"
    return unended.describe(None) if unended else ""


def counted_series(
    all_series: Iterable[Series], stage: Literal["before", "after"]
) -> tuple[Series, ...]:
    """Return the series of a validation that count together, oldest first.

    These are the finished series of the stage, or else the last one begun, as far as the journal's
    stage and the controller's parameters are those of the last.
    """
    # Tests may be spread over several series, but figures of a robot with other parameters are of
    # another robot. An import without an end broke off while it was written: it counts for nothing.
    of_stage = [
        series
        for series in all_series
        if series.started.stage in STAGES[stage]
        and (series.finished or not series.started.imported)
    ]
    counted = [series for series in of_stage if series.finished] or of_stage[-1:]
    return tuple(each for each in counted if _conditions(each) == _conditions(counted[-1]))


def _conditions(series: Series) -> tuple[str, str]:
    """Return the stage of a series and the digest of the controller's parameters."""
    return series.started.stage, series.started.robot_file_digest


def _identified_series(
    all_series: tuple[Series, ...], identification: RecordedIdentification | None
) -> tuple[Series, ...]:
    """Return the series that the identification rests on, or that the next one would rest on."""
    if identification is None:
        measured = (each for each in all_series if each.started.stage in {"run", "import"})
        runs = [each for each in measured if not each.of_known_lengths]
        # the latest finished one, or while none is finished the latest of all
        return tuple(sorted(runs, key=lambda series: (series.finished, series.number))[-1:])
    return tuple(each for each in all_series if each.number == identification.provenance.series)


def _measured(campaign: Campaign, all_series: Iterable[Series]) -> tuple[MeasuredSeries, ...]:
    """Return the series that have any accepted shots."""
    mechanism = campaign.robot.mechanism
    return tuple(MeasuredSeries(series, mechanism) for series in all_series if series.shots)
