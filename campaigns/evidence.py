"""Evidence: everything that a campaign's folder holds, and its evaluation as one value.

Only reads. The report and the live page show it; neither judges anything itself.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
from pydantic import JsonValue

from campaigns.campaign import Campaign
from campaigns.controllers.export import FILE_NAME as PARAMETER_FILE
from campaigns.controllers.load_journal import Load, load_history, read_load
from campaigns.errors import CampaignError, FindingUnreadable
from campaigns.evaluation.campaign_verdict import (
    CampaignVerdict,
    IdentificationVerdict,
    campaign_verdict,
)
from campaigns.evaluation.gains import Gain, gained_in_words, gains, worse_than_before
from campaigns.evaluation.integrity import (
    CampaignDigests,
    Check,
    IdentifiedDigests,
    integrity_checks,
)
from campaigns.evaluation.model_errors import (
    ComparedKinematics,
    ModelErrors,
    SessionShots,
    excluded_rows,
    model_errors,
)
from campaigns.evaluation.residual_budget import ResidualBudget, residual_budget
from campaigns.evaluation.simulated_devices import SimulatedDevices, simulated_devices
from campaigns.evaluation.time_series import TimeSeries, time_series
from campaigns.evaluation.validation import (
    ValidationResult,
    ValidationVerdict,
    evaluate_validation,
    latest_of_each_test,
    validation_verdict,
)
from campaigns.identification.result import (
    RecordedIdentification,
    SessionFrame,
    read_identification,
)
from campaigns.journal.journal import JournalReader
from campaigns.journal.records import (
    Event,
    Finding,
    FindingKind,
    Intent,
    PairVoided,
    Record,
    Rejected,
    Stage,
)
from campaigns.journal.views import Entry, Series
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.parameters import Parameters
from campaigns.planning.plan_file import PlannedShot, plan_digest
from campaigns.planning.plan_match import plan_difference
from campaigns.robots.robot import RobotFile, read_robot
from campaigns.shots.shots import Shots, shots_of_journal

FoundT = TypeVar("FoundT")

IncidentKind = Literal["rejected", "pair voided", "event"]


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredSeries:
    """Series with its accepted shots."""

    series: Series
    shots: Shots
    intents: tuple[Intent, ...] = ()
    """What was asked for of each of them."""


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
            case PairVoided(pair=None, shots=shots):
                return f"shot {', '.join(map(str, shots))}"
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

    series: tuple[Series, ...]
    incidents: tuple[Incident, ...]
    digest: str
    records: int
    identified_digest: str | None
    """Of the records up to where the identification was made, as they are now."""
    unended_load: str = ""
    """Sentence about a load that was begun and not ended; empty when there is none."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Evidence:
    """Everything there is of a campaign; None: it is not there."""

    campaign: Campaign
    journal: JournalFacts | None = None
    before: tuple[MeasuredSeries, ...] = ()
    """Those of the validation, oldest first; of each test the latest counts."""
    run: MeasuredSeries | None = None
    after: tuple[MeasuredSeries, ...] = ()
    identification: RecordedIdentification | None = None
    loaded: Load | None = None
    plan: tuple[PlannedShot, ...] | None = None
    parameter_file: RobotFile | None = None
    unreadable: tuple[str, ...] = ()
    """What is there and cannot be read, and why."""

    @property
    def simulated(self) -> SimulatedDevices:
        """Devices that were simulated, as each series says, or as campaign.yaml plans."""
        series = self.journal.series if self.journal else ()
        return simulated_devices(series, planned=self.campaign.is_simulated)

    def by_stage(self) -> tuple[tuple[str, MeasuredSeries], ...]:
        """The series that are there, in the order in which a campaign measures them."""
        run = () if self.run is None else (self.run,)
        stages = (("before", self.before), ("run", run), ("after", self.after))
        return tuple(
            (name if len(every) == 1 else f"{name}, series {measured.series.number}", measured)
            for name, every in stages
            for measured in every
        )


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Evaluation of a campaign's evidence, worked out as it is asked for.

    None: the campaign does not have it yet.
    """

    evidence: Evidence

    @cached_property
    def before(self) -> ValidationResult | None:
        """Validation before calibration: of each test the latest."""
        return self._validation(self.evidence.before)

    @cached_property
    def after(self) -> ValidationResult | None:
        """Validation after calibration: of each test the latest."""
        return self._validation(self.evidence.after)

    @cached_property
    def gains(self) -> tuple[Gain, ...]:
        """Every figure of the commanded robot before and after."""
        return gains(self.before, self.after)

    @cached_property
    def errors(self) -> ModelErrors | None:
        """Errors of the models."""
        return _errors(self.evidence)

    @cached_property
    def budget(self) -> ResidualBudget | None:
        """Causes of what the model leaves."""
        found, errors, stage = self.evidence.identification, self.errors, self.after or self.before
        if found is None or errors is None:
            return None
        repeated = stage.repeatability.away_mm if stage and stage.repeatability else None
        chi2 = None if found.chi2 is None else found.chi2.value
        return residual_budget(errors, found.estimator, found.dof, chi2, repeated)

    @cached_property
    def checks(self) -> tuple[Check, ...]:
        """Checks of whether the files belong together."""
        return (*integrity_checks(_digests(self.evidence)), *_load_check(self.evidence.journal))

    @cached_property
    def time_series(self) -> tuple[TimeSeries, ...]:
        """Temperature and drift of each series that tells of them."""
        every = (time_series(name, each.shots) for name, each in self.evidence.by_stage())
        return tuple(each for each in every if not each.is_empty)

    def validated(self, stage: Literal["before", "after"]) -> ValidationVerdict:
        """Verdict on the robot in a stage; after calibration it must not be worse than before."""
        limits = self.evidence.campaign.config.acceptance
        if stage == "before":
            return validation_verdict(self.before, limits)
        return validation_verdict(self.after, limits, worse_than_before(self.gains))

    @cached_property
    def verdict(self) -> CampaignVerdict:
        """Verdict on the whole campaign."""
        found = self.evidence.identification
        return campaign_verdict(
            _identification_verdict(found),
            self.validated("after"),
            self.checks,
            validated=self.after is not None,
            gained=gained_in_words(self.gains, found.unseen_mm if found else None),
        )

    def _validation(self, every: tuple[MeasuredSeries, ...]) -> ValidationResult | None:
        instrument = self.evidence.campaign.instrument
        return latest_of_each_test(
            evaluate_validation(each.shots, instrument, each.series.number) for each in every
        )


def evaluate(campaign: Campaign) -> Evaluation:
    """Evaluation of all that a campaign has; raises as `gather` does."""
    return Evaluation(gather(campaign))


def gather(campaign: Campaign) -> Evidence:
    """Read everything that is there; raises `JournalFailed` for a journal that cannot be read."""
    unreadable: list[str] = []
    plan = _read_if_there(campaign.plan_path, lambda _: campaign.read_plan(), unreadable)
    parameters = _read_if_there(
        campaign.path(PARAMETER_FILE), lambda path: read_robot(path).robot, unreadable
    )
    if not campaign.journal_path.exists():
        return Evidence(
            campaign=campaign, plan=plan, parameter_file=parameters, unreadable=tuple(unreadable)
        )
    with campaign.journal_reader() as journal:
        entries, all_series = journal.records(), journal.series()
        identification = _latest(entries, "identification", read_identification, unreadable)
        loaded = _latest(entries, "load", read_load, unreadable)
        unended = _unended_load(journal, unreadable)
        return Evidence(
            campaign=campaign,
            journal=_facts(journal, entries, all_series, identification, unended),
            before=_all_measured(campaign, _chosen(all_series, {"before"})),
            run=_measured(campaign, _identified_series(all_series, identification)),
            after=_all_measured(campaign, _chosen(all_series, {"after", "after by targets"})),
            identification=identification,
            loaded=loaded,
            plan=plan,
            parameter_file=parameters,
            unreadable=tuple(unreadable),
        )


def compared_kinematics(
    found: RecordedIdentification | None, nominal: Kinematics
) -> ComparedKinematics:
    """Kinematics of the identification, or the campaign's nominal one alone."""
    if found is None:
        return ComparedKinematics(before=nominal)
    mechanism = nominal.mechanism
    space, flat = mechanism.parameters, found.flat()
    lost = np.array([flat.get(name, 0.0) for name in space.backlashes])
    return ComparedKinematics(
        before=Kinematics.of(mechanism, found.nominal_flat()),
        after=Kinematics.of(mechanism, flat),
        sessions=_sessions(found),
        backlash=lost * space.units(space.backlashes),
    )


def _sessions(found: RecordedIdentification) -> tuple[SessionShots, ...]:
    """Sessions with frames of their own, or all shots as one."""
    each = found.sessions or (SessionFrame((), found.frame),)
    return tuple(
        SessionShots(
            frozenset(one.shots), None if one.frame is None else one.frame.tracker_from_base
        )
        for one in each
    )


def _read_if_there(
    path: Path, read: Callable[[Path], FoundT], unreadable: list[str]
) -> FoundT | None:
    if not path.exists():
        return None
    try:
        return read(path)
    except CampaignError as error:
        unreadable.append(error.problem)
        return None


def _latest(
    entries: Iterable[Entry[Record]],
    kind: FindingKind,
    read: Callable[[Mapping[str, JsonValue]], FoundT],
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
    except FindingUnreadable as error:
        unreadable.append(f"record {number}: {error.problem}")
        return None


def _unended_load(journal: JournalReader, unreadable: list[str]) -> str:
    try:
        unended = load_history(journal).unended
    except FindingUnreadable as error:
        unreadable.append(error.problem)
        return "a load was begun in a form that this version cannot read"
    return unended.told(None) if unended else ""


def _load_check(journal: JournalFacts | None) -> Iterator[Check]:
    """What a load without an end leaves open; nothing where every one has ended."""
    if journal is not None and journal.unended_load:
        statement = "it is known what the controller holds"
        yield Check(statement, holds=False, detail="a load was begun and not ended")


def _identification_verdict(found: RecordedIdentification | None) -> IdentificationVerdict | None:
    if found is None:
        return None
    accepted = tuple(doubt.says for doubt in found.doubts if doubt.accepted)
    return IdentificationVerdict(found.verdict, found.reasons, accepted)


def _chosen(all_series: Iterable[Series], stages: set[Stage]) -> tuple[Series, ...]:
    """Finished series of these stages, or the last one begun when none is finished.

    All of the last one's stage, and with the same parameters in the controller: what was measured
    with others says nothing of these.
    """
    of_stage = [series for series in all_series if series.started.stage in stages]
    counted = [series for series in of_stage if series.finished] or of_stage[-1:]
    return tuple(each for each in counted if _conditions(each) == _conditions(counted[-1]))


def _conditions(series: Series) -> tuple[str, str]:
    return series.started.stage, series.started.robot_file_digest


def _identified_series(
    all_series: tuple[Series, ...], identification: RecordedIdentification | None
) -> Series | None:
    """The series that the identification rests on, or the one that the next would rest on."""
    if identification is None:
        runs = [each for each in all_series if each.started.stage in {"run", "import"}]
        return max(runs, key=lambda each: (each.finished, each.number), default=None)
    return next((s for s in all_series if s.number == identification.series), None)


def _measured(campaign: Campaign, series: Series | None) -> MeasuredSeries | None:
    if series is None or not series.shots:
        return None
    intents = tuple(shot.intent for shot in series.shots)
    return MeasuredSeries(series, shots_of_journal(series.shots, campaign.robot.mechanism), intents)


def _all_measured(campaign: Campaign, every: Iterable[Series]) -> tuple[MeasuredSeries, ...]:
    found = (_measured(campaign, series) for series in every)
    return tuple(measured for measured in found if measured is not None)


def _facts(
    journal: JournalReader,
    entries: tuple[Entry[Record], ...],
    all_series: tuple[Series, ...],
    identification: RecordedIdentification | None,
    unended_load: str,
) -> JournalFacts:
    through = identification.journal_records if identification else None
    return JournalFacts(
        all_series,
        tuple(
            Incident(entry.at_utc, entry.series, entry.record)
            for entry in entries
            if isinstance(entry.record, Rejected | PairVoided | Event)
        ),
        journal.digest(),
        journal.last_number(),
        None if through is None else journal.digest(through=through),
        unended_load,
    )


def _errors(evidence: Evidence) -> ModelErrors | None:
    if evidence.run is None:
        return None
    campaign, found, shots = evidence.campaign, evidence.identification, evidence.run.shots
    left_out = found.excluded if found else ()
    excluded = excluded_rows(
        shots,
        numbers=frozenset(left.shot for left in left_out),
        pairs=frozenset(left.pair for left in left_out),
    )
    models = compared_kinematics(found, campaign.robot.kinematics)
    return model_errors(shots, models, excluded, campaign.instrument)


def _digests(evidence: Evidence) -> CampaignDigests:
    campaign = evidence.campaign
    mechanism, plan = campaign.robot.mechanism, evidence.plan
    run = None if evidence.run is None else evidence.run.series.started
    plan_now = None if plan is None else plan_digest(plan, mechanism)
    after = evidence.after[-1].series.started if evidence.after else None
    return CampaignDigests(
        plan_now=plan_now,
        plan_measured=_plan_measured(evidence, plan_now),
        is_import=run is not None and run.stage == "import",
        identified=_identified_digests(evidence),
        limits_now=campaign.config.acceptance.model_dump(mode="json"),
        limits_recorded=None if after is None else after.configuration.get("acceptance"),
    )


def _plan_measured(evidence: Evidence, plan_now: str | None) -> str | None:
    """Digest of the plan that was measured: that of plan.csv where it has all that was measured.

    Rows may have come since, and rows gone that were never measured.
    """
    if evidence.run is None:
        return None
    plan, intents = evidence.plan or (), evidence.run.intents
    has_all = {intent.shot for intent in intents} <= {shot.shot for shot in plan}
    if intents and has_all and not plan_difference(intents, plan):
        return plan_now
    return evidence.run.series.started.plan_digest


def _identified_digests(evidence: Evidence) -> IdentifiedDigests | None:
    found, after = evidence.identification, evidence.after[-1:]
    if found is None:
        return None
    file, loaded, journal = evidence.parameter_file, evidence.loaded, evidence.journal
    nominal = evidence.campaign.robot
    return IdentifiedDigests(
        robot=found.robot_digest,
        nominal_now=nominal.digest(),
        journal=found.journal_digest,
        journal_now=None if journal is None else journal.identified_digest,
        parameters=Parameters.of(nominal.mechanism.parameters, found.flat()).digest(),
        file_now=None if file is None else file.digest(),
        loaded=None if loaded is None else loaded.digest,
        validated_with=after[0].series.started.robot_file_digest if after else None,
        by_targets=bool(after) and after[0].series.started.stage == "after by targets",
    )
