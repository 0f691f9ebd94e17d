"""Evidence: everything that a campaign's folder holds, and its evaluation, as one value each."""

# `gather` reads the folder once and writes nothing: settings, plan.csv, the exported robot file and
# the journal become one immutable value, `Evidence`. What is missing is None or empty. What is
# there and cannot be read becomes a sentence in `unreadable`, so that one spoilt file hides
# nothing else; only a journal that cannot be read is an error.
#
# `Evaluation` derives from this value, part by part when it is needed: the figures of both
# validations, the gains, the errors of both models, the checks and the verdict. Report, live page,
# `status` and next step take their statements from here and judge nothing themselves, so that they
# cannot contradict each other.
#
# The checks form the chain from plan to controller; most links compare two digests. plan.csv must
# be the plan that was measured; nominal robot and journal those that were identified from; the
# parameter file, the last load and the set that the controller held in the validation must be the
# identified set or a form of it. A link that does not hold keeps the verdict from being a pass.

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
from pydantic import JsonValue

from campaigns.campaign import Campaign
from campaigns.controllers.controller_state import ControllerState, KnownSets
from campaigns.controllers.export import FILE_NAME as PARAMETER_FILE
from campaigns.controllers.export import PLAIN, WrittenSet, written_sets
from campaigns.controllers.load_journal import Load, load_history, read_load
from campaigns.errors import CampaignError, FindingUnreadable, OutputExists, PlanInvalid
from campaigns.evaluation import model_errors, validation
from campaigns.evaluation.robot_scatter import RobotScatter
from campaigns.evaluation.simulated_devices import OWN_EQUATIONS, simulated_devices
from campaigns.evaluation.stated_sources import SeriesSources, restated_observations
from campaigns.evaluation.time_series import TimeSeries, time_series
from campaigns.evaluation.verdict import (
    CampaignVerdict,
    Check,
    Gain,
    IdentificationVerdict,
    ValidationVerdict,
    campaign_verdict,
    gained_in_words,
    gains,
    lost_beyond,
    same_digest,
    validation_verdict,
    worse_than_before,
)
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
    plan_difference,
    plan_digest,
    read_options,
    read_plan,
)
from campaigns.robots.robot import RobotFile, read_robot
from campaigns.settings.instrument import NamedInstruments, StatedInstrument
from campaigns.shots.observation_records import (
    NO_OBSERVATIONS,
    RecordedObservations,
    recorded_observations,
)
from campaigns.shots.observations_csv import FILE_NAME as OBSERVATIONS
from campaigns.shots.observations_csv import read_observations
from campaigns.shots.shot_sets import ShotSet
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


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Evaluation of a campaign: what its report shows, computed at first use.

    Each attribute is None or empty if the campaign has not got that far.

    Attributes:
        evidence: Everything read from the campaign's folder.
        before: Figures of the validation before calibration, mm, with their uncertainties.
        after: Figures of the validation after calibration.
        scatter: The robot's scatter, which is in the uncertainties of both.
        gains: Each figure before and after.
        errors: Errors of the nominal and the identified model at the measured shots, mm.
        checks: Statements on whether plan, journal, files and controller belong together.
        time_series: Temperature and drift of each series.
        verdict: Decision on the whole campaign, with its reasons.
    """

    evidence: Evidence

    @cached_property
    def scatter(self) -> RobotScatter:
        """Scatter of the robot: by the identification, else by the latest repeated visits."""
        robot, identification = self.evidence.campaign.robot, self.evidence.identification
        if identification and (scatter := identification.uncertainty.scatter) is not None:
            fitted = identification.residuals.fitted
            shots = len(fitted.numbers) if fitted is not None else identification.provenance.shots
            return RobotScatter.identified(scatter.point_mm, scatter.joint, shots, robot.kinematics)
        measured = (*self.evidence.before, *self.evidence.after)
        by_visits = (validation.scatter_of_visits(item.shots) for item in reversed(measured))
        return next((scatter for scatter in by_visits if scatter.is_known), RobotScatter())

    @cached_property
    def before(self) -> validation.ValidationResult | None:
        """Figures of the validation before calibration: of each test the latest."""
        return self._validation(self.evidence.before)

    @cached_property
    def after(self) -> validation.ValidationResult | None:
        """Figures of the validation after calibration: of each test the latest."""
        return self._validation(self.evidence.after)

    @cached_property
    def gains(self) -> tuple[Gain, ...]:
        """Each figure of the commanded robot before and after."""
        return gains(self.before, self.after)

    @cached_property
    def errors(self) -> model_errors.ModelErrors | None:
        """Errors of the nominal and the identified model at the measured shots, mm."""
        modelled = _modelled(self.evidence)
        if modelled is None:
            return None
        return model_errors.ModelErrors(
            model_errors.pair_errors(modelled, ShotSet.IDENTIFICATION),
            model_errors.pair_errors(modelled, ShotSet.VALIDATION),
            model_errors.position_errors(modelled),
        )

    @cached_property
    def checks(self) -> tuple[Check, ...]:
        """Statements on whether plan, journal, files and controller belong together."""
        return tuple(_checks(self.evidence))

    @cached_property
    def time_series(self) -> tuple[TimeSeries, ...]:
        """Temperature and drift of each series that has them."""
        courses = (time_series(name, each.shots) for name, each in self.evidence.by_stage())
        return tuple(course for course in courses if not course.is_empty)

    def validated(self, stage: Literal["before", "after"]) -> ValidationVerdict:
        """Return the verdict on a stage by the limits in campaign.yaml.

        After calibration the robot must also not be worse than before, and a reduced form must
        not lose more than a limit anywhere in the workspace.
        """
        limits = self.evidence.campaign.config.acceptance
        axes = self.evidence.campaign.robot.mechanism.line_axes
        if stage == "before":
            return validation_verdict(self.before, limits, axes=axes)
        held = self.evidence.held("after")
        form = held.form if held else None
        worse = worse_than_before(self.gains)
        return validation_verdict(self.after, limits, worse, lost_beyond(form, limits), axes)

    @cached_property
    def verdict(self) -> CampaignVerdict:
        """Verdict on the whole campaign."""
        identification, of_identification = self.evidence.identification, None
        if identification is not None:
            judged = identification.judgement
            of_identification = IdentificationVerdict(
                judged.verdict, judged.reasons, judged.accepted
            )
        return campaign_verdict(
            of_identification,
            self.validated("after"),
            self.checks,
            validated=self.after is not None,
            notes=(*self._held_in_words(), *_limits_set_later(self.evidence)),
            gained=gained_in_words(
                self.gains, identification.residuals.unseen_mm if identification else None
            ),
        )

    def _held_in_words(self) -> Iterator[str]:
        """Yield sentences on what the controller held, where it was a form or was declared."""
        for stage in STAGES:
            held = self.evidence.held(stage)
            if held is not None and (held.form or held.declared):
                yield f"Validated {stage} with {held.says}."

    def _validation(
        self, measured: tuple[MeasuredSeries, ...]
    ) -> validation.ValidationResult | None:
        """Return the figures of a stage's series; None without any."""
        campaign = self.evidence.campaign
        return validation.latest_of_each_test(
            validation.evaluate_validation(
                item.stops,
                campaign.instrument_of(item.series.started).uncertainty,
                item.series.number,
                self.scatter,
            )
            for item in measured
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


def evaluate(campaign: Campaign) -> Evaluation:
    """Evaluate all that a campaign has: figures, gains, checks and verdict, as its report has them.

    Args:
        campaign: The campaign, from `open_campaign`; at any stage.

    Returns:
        `before`, `after`, `gains`, `errors`, `checks`, `time_series` and `verdict`, computed at
        first use; None or empty where the campaign has not got that far.

    Raises:
        JournalFailed: The journal cannot be read.

    Example:
        >>> evaluation = evaluate(open_campaign("cell-7"))
        >>> evaluation.verdict.decision
        'pass'
        >>> evaluation.after.distances.mean.value_mm
    """
    return Evaluation(gather(campaign))


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


def _modelled(evidence: Evidence) -> model_errors.ModelledShots | None:
    """Return the identified and the hold-out shots, with the poses of both models.

    Before an identification there is the nominal model alone, at shots that it can assemble. None
    without shots, and for an old identification that kept no poses.
    """
    if evidence.run is None:
        return None
    identification, nominal = evidence.identification, evidence.campaign.robot.kinematics
    shots = evidence.run.stops.of_set(ShotSet.IDENTIFICATION, ShotSet.VALIDATION)
    if identification is None:
        solution, after = nominal.forward(shots.joints), None
        rows = np.flatnonzero(solution.is_solved)
        shots, before = shots.rows(rows), solution.values[rows]
    elif identification.residuals.modelled is None:  # by the paper's method in an older version
        return None
    else:
        # The identification kept which shots it used and how: options may have moved shots
        # between the sets, or left them out. Its table counts, not the plan's purposes.
        table = identification.residuals.modelled
        if not set(table.numbers) <= set(shots.numbers):  # of a version that averaged no samples
            shots = evidence.run.shots
        rows_by_number = {number: row for row, number in enumerate(shots.numbers)}
        rows = np.array([rows_by_number[number] for number in table.numbers], dtype=np.intp)
        shots = replace(shots.rows(rows), purposes=table.purposes, pairs=table.pairs)
        before, after = np.array(table.before), np.array(table.after)
    return model_errors.ModelledShots(
        shots=shots,
        before=before,
        after=after,
        points=nominal.points,
        sessions=identification is not None and bool(identification.value.sessions),
    )


def _checks(evidence: Evidence) -> Iterator[Check]:
    """Yield the checks of the chain from plan to controller."""
    run, identification, journal = evidence.run, evidence.identification, evidence.journal
    # an import was measured without plan.csv
    without_plan = evidence.observations.files if run is None else _is_imported(run)
    if not without_plan:
        now, measured = _plan_digests_to_compare(evidence)
        of_plan = same_digest("plan.csv is the plan that was measured", now, measured)
        kept = evidence.older_plans.get(measured or "")
        if of_plan.holds is False and kept:
            of_plan = replace(of_plan, detail=f"{of_plan.detail}; {kept} is: rename it to plan.csv")
        yield of_plan
    if identification is None:
        yield Check("the results belong to one identification", None, "nothing was identified")
    else:
        mechanism = evidence.campaign.robot.mechanism
        parameters = identification.value.parameter_set(mechanism).digest()
        yield from _checks_of_bases(evidence, identification)
        yield _check_of_file(evidence, parameters)
        yield from _checks_of_controller(evidence, parameters)
    check = evidence.unanswered
    if check is not None and check.decision == "fail":
        detail = f"check, series {check.series}: {check.says}"
        yield Check("the robot is as it was identified", holds=False, detail=detail)
    yield _check_of_start(evidence)
    yield from checks_of_instrument(evidence)
    if journal is not None and journal.unended_load:
        statement = "it is known what the controller holds"
        yield Check(statement, holds=False, detail="a load was begun and not ended")


def _is_imported(run: MeasuredSeries) -> bool:
    """Return whether the shots to identify from were measured elsewhere."""
    return run.series.started.stage == "import"


def _plan_digests_to_compare(evidence: Evidence) -> tuple[str | None, str | None]:
    """Return the digests of plan.csv and of the measured plan, None for a missing one.

    Both are that of plan.csv if it has every measured shot as it was measured.
    """
    # An operator may add rows to plan.csv during a run, and delete rows that cannot be measured.
    # So equal digests are not demanded: it is the same plan if it has every measured shot as it
    # was measured.
    plan, now = evidence.plan, evidence.plan_digest
    if evidence.run is None:
        return now, None
    intents = [shot.intent for shot in evidence.run.series.shots]
    has_all = {intent.shot for intent in intents} <= {shot.shot for shot in plan or ()}
    if intents and has_all and not plan_difference(intents, plan or ()):
        return now, now
    return now, evidence.run.series.started.plan_digest


def _checks_of_bases(evidence: Evidence, identification: RecordedIdentification) -> Iterator[Check]:
    """Yield the checks that nominal robot, journal and settings are those of the identification."""
    journal, provenance = evidence.journal, identification.provenance
    statement = "the nominal robot is the one that was identified from"
    yield same_digest(statement, evidence.campaign.robot.digest(), provenance.robot_digest)
    statement = "the journal is unchanged up to the identification"
    journal_now = None if journal is None else journal.identified_digest
    yield same_digest(statement, journal_now, provenance.journal_digest)
    statement = "campaign.yaml says what it said when the identification was judged by it"
    if outdated := evidence.campaign.outdated(identification):
        yield Check(statement, holds=False, detail=f"{', '.join(outdated)} changed since")
    else:
        yield Check(statement, holds=True, detail="as then")


def _check_of_file(evidence: Evidence, identified: str) -> Check:
    """Check that the exported robot file, or else a form in the folder, is of the identified set.

    `identified` is the digest of this set.
    """
    statement = "the parameter file contains the identified parameters"
    if evidence.spoilt_parameter_file:
        return Check(statement, holds=False, detail="it cannot be read")
    form_origins = [form.projection.of for form in evidence.forms if form.projection]
    origin = evidence.file_origin or next(iter(form_origins), None)
    return same_digest(statement, origin, identified)


def _checks_of_controller(evidence: Evidence, identified: str) -> Iterator[Check]:
    """Yield the checks that the identified set came to the controller, by whichever route.

    `identified` is the digest of this set.
    """
    # Three routes: the set was loaded; or it was declared, and whatever was loaded earlier says
    # nothing; or targets were corrected with it, and nothing was loaded. So the last load is
    # compared on the first route alone.
    held, loaded = evidence.held("after"), evidence.loaded
    by_targets = held is not None and held.targets
    if not by_targets and not (held and held.declared):
        last = evidence.state(loaded.digest if loaded else None)
        yield _same_origin("what was loaded last is what was identified", last, identified)
    route = "the controller held the identified set"
    if by_targets:
        route = "targets were corrected with the identified set"
    yield _same_origin(f"{route} when the robot was validated after", held, identified)
    if loaded and held and held.origin == identified and evidence.loaded_since:
        statement = "the robot was validated after with what its controller holds now"
        yield Check(statement, holds=False, detail=f"{loaded.source} was loaded since")


def _same_origin(statement: str, held: ControllerState | None, identified: str) -> Check:
    """Check that a set is the identified one, or a form of it; the detail names the form."""
    if held is None or not held.origin:
        return same_digest(statement, held.digest if held else None, identified)
    check = same_digest(statement, held.origin, identified)
    is_qualified = held.form or held.declared
    return replace(check, detail=f"{held.says}, {check.detail}") if is_qualified else check


def _check_of_start(evidence: Evidence) -> Check:
    """Check that the robot was validated before calibration with nominal parameters.

    A campaign passes without it: the gain is then measured from the set that was held.
    """
    statement = "the controller held the nominal parameters when the robot was validated before"
    held = evidence.held("before")
    if held is None:
        return Check(statement, None, "nothing to compare", decides=False)
    return Check(statement, held.kind == "nominal", held.says, decides=False)


def checks_of_instrument(evidence: Evidence) -> Iterator[Check]:
    """Yield the checks that what is stated of the instruments is what their records state."""
    config, sources = evidence.campaign.config, sources_of(evidence)
    names = NamedInstruments.of(config.tracker, config.instruments)
    yield from sources.changed_later(StatedInstrument.of(config.tracker), names)
    yield from sources.restated()
    yield from restated_observations(evidence.observations.restated)


def sources_of(evidence: Evidence) -> SeriesSources:
    """Return the series with what their records state of the instruments."""
    return SeriesSources(
        counted=tuple(item.series for item in evidence.counted()),
        every=evidence.journal.series if evidence.journal else (),
        mechanism=evidence.campaign.robot.mechanism,
        instrument_of=evidence.campaign.instrument_of,
    )


def _limits_set_later(evidence: Evidence) -> Iterator[str]:
    """Yield a sentence if the limits were set or changed after the validation after calibration."""
    # Limits may be agreed late, but a reader of the verdict has to know: they could be chosen so
    # that the measured figures meet them.
    after = evidence.after[-1].series.started if evidence.after else None
    recorded = after.configuration.get("acceptance") if after else None
    config = evidence.campaign.config.acceptance.model_dump(mode="json")
    if not isinstance(recorded, dict) or not any(config.values()):
        return
    # a limit that the journal's version did not know was not set then
    if {**dict.fromkeys(config), **recorded} != config:
        changed_s = evidence.campaign.path("campaign.yaml").stat().st_mtime
        moment = datetime.fromtimestamp(changed_s, UTC).isoformat(" ", "minutes")
        yield f"Limits set after that validation, in campaign.yaml of {moment}."
