"""Evidence: everything that a campaign's folder holds, and its evaluation as one value.

Only reads. The report and the live page show it; neither judges anything itself.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
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
from campaigns.errors import CampaignError, FindingUnreadable
from campaigns.evaluation import model_errors, validation
from campaigns.evaluation.simulated_devices import simulated_devices
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
from campaigns.identification.checking import RecordedCheck, read_check
from campaigns.identification.result import RecordedIdentification, read_identification
from campaigns.journal.journal import JournalReader
from campaigns.journal.records import Event, Finding, FindingKind, PairVoided, Rejected, Stage
from campaigns.journal.views import Series
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.planning.plan_file import PlannedShot, plan_difference, plan_digest
from campaigns.robots.robot import RobotFile, read_robot
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots, shots_of_journal
from drivers.bounded_files import is_file
from drivers.texts import quoted

FoundT = TypeVar("FoundT")
STAGES: Mapping[Literal["before", "after"], frozenset[Stage]] = {
    "before": frozenset({"before"}),
    "after": frozenset({"after", "after by targets"}),
}
"""Stages of series that count as each of a validation's."""


@dataclass(frozen=True, eq=False)
class MeasuredSeries:
    """Series with its accepted shots as arrays, which are made when they are asked for."""

    series: Series
    mechanism: ClosedChain

    @cached_property
    def shots(self) -> Shots:
        """Accepted shots."""
        return shots_of_journal(self.series.shots, self.mechanism)


@dataclass(frozen=True, slots=True)
class Incident:
    """Something that went otherwise than planned, or that the operator should know."""

    at_utc: str
    series: int | None
    record: Rejected | PairVoided | Event

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
    records: int
    digest: str
    """Digest of all records."""
    identified_digest: str | None
    """Digest of the records up to where the identification was made, as they are now."""
    unended_load: str = ""
    """Sentence about a load that was begun and not ended; empty when there is none."""


@dataclass(frozen=True, eq=False, kw_only=True)
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
    checked: RecordedCheck | None = None
    plan: tuple[PlannedShot, ...] | None = None
    parameter_file: RobotFile | None = None
    spoilt_parameter_file: bool = False
    """Whether it is there and cannot be read."""
    sets: KnownSets | None = None
    """Parameter sets that the journal knows."""
    written: WrittenSet | None = None
    """What `export` or `correct` wrote last."""
    forms: tuple[WrittenSet, ...] = ()
    """Forms of identified sets that are robot files in the campaign's folder, latest first."""
    program_after: bool = False
    """Whether there is a program of what was written last."""
    unreadable: tuple[str, ...] = ()
    """What is there and cannot be read, and why."""

    @cached_property
    def plan_digest(self) -> str | None:
        """Digest of plan.csv."""
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
        """Return the state of the controller in a stage; None where it was not validated."""
        every = self.before if stage == "before" else self.after
        if not every:
            return None
        started = every[-1].series.started
        state, targets = self.state(started.robot_file_digest), started.stage == "after by targets"
        return state and replace(state, targets=targets, declared=started.declared)

    @property
    def file_origin(self) -> str | None:
        """Digest of the set that the parameter file holds, or is a form of, as for warmer parts."""
        if self.parameter_file is None:
            return None
        digest = self.parameter_file.digest()
        state = self.state(digest)
        return state.origin if state and state.origin else digest

    @property
    def loaded_since(self) -> bool:
        """Whether, since it was validated after, the controller was given another set.

        Beside corrected targets any but the nominal one is another.
        """
        after, loaded = self.held("after"), self.loaded
        if after is None or after.declared or loaded is None or self.sets is None:
            return False
        held = self.campaign.robot.digest() if after.targets else after.digest
        return self._is_loaded_later and not self.sets.are_one(loaded.digest, held)

    @property
    def _is_loaded_later(self) -> bool:
        """Whether the last load came after the last validation began."""
        if self.loaded is None or not self.loaded.at_utc:
            return False
        started = self.after[-1].series.started_utc
        return datetime.fromisoformat(self.loaded.at_utc) > datetime.fromisoformat(started)

    @property
    def controller(self) -> ControllerState | None:
        """State of the controller by what was loaded last, or read since for a validation."""
        after = self.held("after")
        if after is None or after.declared or after.targets or self._is_loaded_later:
            return self.state(self.loaded.digest if self.loaded else None)
        return after

    @property
    def unanswered(self) -> RecordedCheck | None:
        """Latest check, where it is not good and no new shots followed it."""
        check, identification = self.checked, self.identification
        if check is None or identification is None or check.decision == "pass":
            return None
        series = self.journal.series if self.journal else ()
        new = any(each.number > check.series and each.to_identify for each in series)
        return None if new else check

    @property
    def simulated(self) -> str:
        """Sentence on simulated devices, as each series says, or as campaign.yaml plans."""
        series = self.journal.series if self.journal else ()
        return simulated_devices(series, planned=self.campaign.is_simulated)

    def by_stage(self) -> tuple[tuple[str, MeasuredSeries], ...]:
        """Return the series that are there, in the order in which a campaign measures them."""
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
    def before(self) -> validation.ValidationResult | None:
        """Validation before calibration: of each test the latest."""
        return self._validation(self.evidence.before)

    @cached_property
    def after(self) -> validation.ValidationResult | None:
        """Validation after calibration: of each test the latest."""
        return self._validation(self.evidence.after)

    @cached_property
    def gains(self) -> tuple[Gain, ...]:
        """Every figure of the commanded robot before and after."""
        return gains(self.before, self.after)

    @cached_property
    def errors(self) -> model_errors.ModelErrors | None:
        """Errors of the models."""
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
        """Checks of whether the files belong together."""
        return tuple(_checks(self.evidence))

    @cached_property
    def time_series(self) -> tuple[TimeSeries, ...]:
        """Temperature and drift of each series that has them."""
        every = (time_series(name, each.shots) for name, each in self.evidence.by_stage())
        return tuple(each for each in every if not each.is_empty)

    def validated(self, stage: Literal["before", "after"]) -> ValidationVerdict:
        """Return the verdict on a stage; after calibration it must not be worse than before."""
        limits = self.evidence.campaign.config.acceptance
        if stage == "before":
            return validation_verdict(self.before, limits)
        held = self.evidence.held("after")
        form = held.form if held else None
        worse = worse_than_before(self.gains)
        return validation_verdict(self.after, limits, worse, lost_beyond(form, limits))

    @cached_property
    def verdict(self) -> CampaignVerdict:
        """Verdict on the whole campaign."""
        identification = self.evidence.identification
        return campaign_verdict(
            None
            if identification is None
            else IdentificationVerdict(
                identification.verdict, identification.reasons, identification.accepted
            ),
            self.validated("after"),
            self.checks,
            validated=self.after is not None,
            notes=(*self._held_in_words(), *_limits_set_later(self.evidence)),
            gained=gained_in_words(
                self.gains, identification.unseen_mm if identification else None
            ),
        )

    def _held_in_words(self) -> Iterator[str]:
        """Return what the controller held in each stage, unless that is evident."""
        for stage in STAGES:
            held = self.evidence.held(stage)
            if held is not None and (held.form or held.declared):
                yield f"Validated {stage} with {held.says}."

    def _validation(self, every: tuple[MeasuredSeries, ...]) -> validation.ValidationResult | None:
        instrument = self.evidence.campaign.instrument
        return validation.latest_of_each_test(
            validation.evaluate_validation(item.shots, instrument, item.series.number)
            for item in every
        )


def program_path(folder: Path, stage: str) -> Path:
    """Return the file of a stage's program for a controller out of reach."""
    return folder / f"program-{stage}.csv"


def is_program_there(folder: Path, stage: str, digest: str) -> bool:
    """Return whether a stage's program names this digest in its heading."""
    path = program_path(folder, stage)
    if not is_file(path):
        return False
    with path.open("rb") as file:
        return digest.encode() in file.read(4000)


def evaluate(campaign: Campaign) -> Evaluation:
    """Return the evaluation of all that a campaign has; raise as `gather` does."""
    return Evaluation(gather(campaign))


def gather(campaign: Campaign) -> Evidence:
    """Read everything that is there; raises `JournalFailed` for a journal that cannot be read."""
    unreadable: list[str] = []
    path = campaign.path(PARAMETER_FILE)
    parameters = _read_if_there(path, lambda path: read_robot(path).robot, unreadable)
    files = Evidence(
        campaign=campaign,
        plan=_read_if_there(campaign.plan_path, lambda _: campaign.read_plan(), unreadable),
        parameter_file=parameters,
        spoilt_parameter_file=parameters is None and path.exists(),
        unreadable=tuple(unreadable),
    )
    if not campaign.journal_path.exists():
        return files
    with campaign.journal_reader() as journal:
        return _with_journal(files, journal)


def _with_journal(files: Evidence, journal: JournalReader) -> Evidence:
    """Return the evidence of the files with what the journal says."""
    campaign, unreadable = files.campaign, [*files.unreadable]
    entries, all_series = journal.records(), journal.series()
    identification = _latest(journal, "identification", read_identification, unreadable)
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
        through = min(identification.journal_records, journal.last_number())
        identified_digest = journal.digest(through=through)
    run = _measured(campaign, _identified_series(all_series, identification))
    findings = [entry.record for entry in entries if isinstance(entry.record, Finding)]
    every_written = tuple(written_sets(journal))
    written = next(iter(every_written), None)
    return replace(
        files,
        journal=JournalFacts(
            series=all_series,
            incidents=incidents,
            records=journal.last_number(),
            digest=journal.digest(),
            identified_digest=identified_digest,
            unended_load=_unended_load(journal, unreadable).replace(
                "DIR", quoted(str(campaign.folder))
            ),
        ),
        before=_measured(campaign, _chosen(all_series, STAGES["before"])),
        run=run[0] if run else None,
        after=_measured(campaign, _chosen(all_series, STAGES["after"])),
        identification=identification,
        loaded=loaded,
        checked=_latest(journal, "check", read_check, unreadable),
        sets=KnownSets.of(campaign.robot, findings),
        written=written,
        forms=tuple(_forms_there(campaign, every_written)),
        program_after=written is not None
        and is_program_there(campaign.folder, "after", written.digest),
        unreadable=tuple(unreadable),
    )


def _forms_there(campaign: Campaign, written: Iterable[WrittenSet]) -> Iterator[WrittenSet]:
    """Return what was written last to each file that is a form to be loaded, latest first."""
    names = set[str]()
    for export in written:
        if export.file not in names and campaign.path(export.file).exists():
            names.add(export.file)
            if export.projection and export.projection.name == PLAIN:
                yield export


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
    journal: JournalReader,
    kind: FindingKind,
    read: Callable[[Mapping[str, JsonValue]], FoundT],
    unreadable: list[str],
) -> FoundT | None:
    """Read the last finding of a kind; None without one, or where it cannot be read."""
    for entry in journal.findings(kind)[-1:]:
        try:
            return read(entry.record.body)
        except FindingUnreadable as error:
            unreadable.append(f"record {entry.number}: {error.problem}")
    return None


def _unended_load(journal: JournalReader, unreadable: list[str]) -> str:
    try:
        _, unended = load_history(journal)
    except FindingUnreadable as error:
        unreadable.append(error.problem)
        return "a load was begun in a form that this version cannot read"
    return unended.describe(None) if unended else ""


def _chosen(all_series: Iterable[Series], stages: frozenset[Stage]) -> tuple[Series, ...]:
    """Return finished series of these stages, or the last one begun when none is finished.

    All of the last one's stage, and with the same parameters in the controller: what was measured
    with others says nothing of these.
    """
    of_stage = [
        series
        for series in all_series
        if series.started.stage in stages and (series.finished or not series.started.imported)
    ]
    counted = [series for series in of_stage if series.finished] or of_stage[-1:]
    return tuple(each for each in counted if _conditions(each) == _conditions(counted[-1]))


def _conditions(series: Series) -> tuple[str, str]:
    return series.started.stage, series.started.robot_file_digest


def _identified_series(
    all_series: tuple[Series, ...], identification: RecordedIdentification | None
) -> tuple[Series, ...]:
    """Return the series that the identification rests on, or that the next would rest on."""
    if identification is None:
        measured = (each for each in all_series if each.started.stage in {"run", "import"})
        runs = [each for each in measured if not each.of_known_lengths]
        return tuple(sorted(runs, key=lambda series: (series.finished, series.number))[-1:])
    return tuple(each for each in all_series if each.number == identification.series)


def _measured(campaign: Campaign, every: Iterable[Series]) -> tuple[MeasuredSeries, ...]:
    """Return the series in which any shot counts."""
    mechanism = campaign.robot.mechanism
    return tuple(MeasuredSeries(series, mechanism) for series in every if series.shots)


def _modelled(evidence: Evidence) -> model_errors.ModelledShots | None:
    """Return the shots that were identified from or kept unseen, with the poses of both models.

    Before an identification all that can be assembled; None without shots.
    """
    if evidence.run is None:
        return None
    identification, nominal = evidence.identification, evidence.campaign.robot.kinematics
    shots = evidence.run.shots.of_set(ShotSet.IDENTIFICATION, ShotSet.VALIDATION)
    if identification is None:
        solution, after = nominal.forward(shots.joints), None
        rows = np.flatnonzero(solution.is_solved)
        shots, before = shots.rows(rows), solution.values[rows]
    elif identification.modelled is None:  # by the paper's method in an older version
        return None
    else:
        table, places = (
            identification.modelled,
            {number: row for row, number in enumerate(shots.numbers)},
        )
        shots = shots.rows(np.array([places[number] for number in table.numbers], dtype=np.intp))
        shots = replace(shots, purposes=table.purposes, pairs=table.pairs)
        before, after = np.array(table.before), np.array(table.after)
    return model_errors.ModelledShots(
        shots=shots,
        before=before,
        after=after,
        sessions=identification is not None and bool(identification.sessions),
    )


def _checks(evidence: Evidence) -> Iterator[Check]:
    """Check every link of the chain from plan to controller."""
    run, identification, journal = evidence.run, evidence.identification, evidence.journal
    if run is None or run.series.started.stage != "import":
        yield same_digest("plan.csv is the plan that was measured", *_plan_digests(evidence))
    if identification is None:
        yield Check("the results belong to one identification", None, "nothing was identified")
    else:
        yield from _identified_checks(evidence, identification)
    check = evidence.unanswered
    if check is not None and check.decision == "fail":
        detail = f"check, series {check.series}: {check.says}"
        yield Check("the robot is as it was identified", holds=False, detail=detail)
    yield _before_check(evidence)
    if journal is not None and journal.unended_load:
        statement = "it is known what the controller holds"
        yield Check(statement, holds=False, detail="a load was begun and not ended")


def _plan_digests(evidence: Evidence) -> tuple[str | None, str | None]:
    """Return the digests of plan.csv and of the plan that was measured.

    Rows may have come since, and rows gone that were never measured.
    """
    plan, now = evidence.plan, evidence.plan_digest
    if evidence.run is None:
        return now, None
    intents = [shot.intent for shot in evidence.run.series.shots]
    has_all = {intent.shot for intent in intents} <= {shot.shot for shot in plan or ()}
    if intents and has_all and not plan_difference(intents, plan or ()):
        return now, now
    return now, evidence.run.series.started.plan_digest


def _identified_checks(
    evidence: Evidence, identification: RecordedIdentification
) -> Iterator[Check]:
    """Check the digests that the identification stated, and of what it found."""
    nominal, journal = evidence.campaign.robot, evidence.journal
    parameters = identification.parameter_set(nominal.mechanism).digest()
    statement = "the nominal robot is the one that was identified from"
    yield same_digest(statement, nominal.digest(), identification.robot_digest)
    statement = "the journal is unchanged up to the identification"
    journal_now = None if journal is None else journal.identified_digest
    yield same_digest(statement, journal_now, identification.journal_digest)
    statement = "campaign.yaml says what it said when the identification was judged by it"
    if outdated := evidence.campaign.outdated(identification):
        yield Check(statement, holds=False, detail=f"{', '.join(outdated)} changed since")
    else:
        yield Check(statement, holds=True, detail="as then")
    loaded = evidence.loaded
    statement = "the parameter file contains the identified parameters"
    forms = [form.projection.of for form in evidence.forms if form.projection]
    if evidence.spoilt_parameter_file:
        yield Check(statement, holds=False, detail="it cannot be read")
    else:
        yield same_digest(statement, evidence.file_origin or next(iter(forms), None), parameters)
    after = evidence.after[-1].series.started if evidence.after else None
    how = "the controller held the identified set"
    if after is not None and after.stage == "after by targets":
        how = "targets were corrected with the identified set"
    elif after is None or not after.declared:
        last = evidence.state(loaded.digest if loaded else None)
        yield _same_origin("what was loaded last is what was identified", last, parameters)
    statement, held = f"{how} when the robot was validated after", evidence.held("after")
    yield _same_origin(statement, held, parameters)
    if loaded and held and held.origin == parameters and evidence.loaded_since:
        statement = "the robot was validated after with what its controller holds now"
        yield Check(statement, holds=False, detail=f"{loaded.source} was loaded since")


def _same_origin(statement: str, held: ControllerState | None, identified: str) -> Check:
    """Check that a set is the identified one, or a form of it."""
    if held is None or not held.origin:
        return same_digest(statement, held.digest if held else None, identified)
    check = same_digest(statement, held.origin, identified)
    is_qualified = held.form or held.declared
    return replace(check, detail=f"{held.says}, {check.detail}") if is_qualified else check


def _before_check(evidence: Evidence) -> Check:
    """Check that errors before calibration are those of the nominal robot."""
    statement = "the controller held the nominal parameters when the robot was validated before"
    held = evidence.held("before")
    if held is None:
        return Check(statement, None, "nothing to compare", decides=False)
    return Check(statement, held.kind == "nominal", held.says, decides=False)


def _limits_set_later(evidence: Evidence) -> Iterator[str]:
    """Say when the limits were set, if others or none stood when the robot was validated after."""
    after = evidence.after[-1].series.started if evidence.after else None
    recorded = after.configuration.get("acceptance") if after else None
    config = evidence.campaign.config.acceptance.model_dump(mode="json")
    if recorded is not None and recorded != config and any(config.values()):
        changed_s = evidence.campaign.path("campaign.yaml").stat().st_mtime
        moment = datetime.fromtimestamp(changed_s, UTC).isoformat(" ", "minutes")
        yield f"Limits set after that validation, in campaign.yaml of {moment}."
