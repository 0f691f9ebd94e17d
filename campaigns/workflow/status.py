"""Status of a campaign: its phase, what is open or doubtful, and the next step.

Only reads, and takes no lock: another process may be measuring meanwhile.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from itertools import pairwise
from typing import Self

from campaigns.assessment import Evaluation, evaluate
from campaigns.campaign import Campaign, CampaignFolder, open_campaign
from campaigns.evaluation.decision import Verdict
from campaigns.evidence import Evidence, unended_load
from campaigns.files.lock import Holder, lock_holder
from campaigns.journal.records import Stage
from campaigns.journal.views import Series
from campaigns.measuring.resume import resume_state
from campaigns.measuring.run_state import LATEST_SHOTS, time_left_s
from campaigns.next_step import CampaignState, NextStep, state_of
from campaigns.planning.plan_file import PlannedShot, plan_difference
from campaigns.planning.steps import joint_steps
from campaigns.robots.program import ProgramUntrusted
from campaigns.shots.observation_records import RecordedFile
from campaigns.workflow.next_hint import next_hint
from drivers.texts import as_word, moment

LONGEST_PAUSE_S = 600.0
"""Longest time between two shots that counts for the pace; a longer one was a break."""
DOING: Mapping[Stage, str] = {
    "run": "measuring",
    "before": "validating before calibration",
    "after": "validating after calibration",
    "after by targets": "validating after calibration, by corrected targets",
    "check": "checking",
}
"""What a process does while a series of this stage is not finished."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageProgress:
    """Progress of a series of the journal."""

    series: int
    """Number of the series."""
    stage: Stage
    shots: int
    """Number of measured shots; of a run only those of whole pairs."""
    planned: int | None
    """Number of shots to measure, for a run those in plan.csv; None if unknown."""
    finished: bool
    latest_utc: str
    """Time of the latest shot; of a series without shots the time when it began."""
    ends_utc: tuple[str, str] | None
    """Earliest and latest end by the pace of the last shots; None if finished or unknown."""

    @property
    def doing(self) -> str:
        """What a process that measures the series does, how far it is, and when it ends."""
        of = f" of {self.planned}" if self.planned is not None else ""
        words = f"{DOING.get(self.stage, self.stage)}, {self.shots}{of} shots"
        if self.ends_utc is None:
            return words
        low, high = (f"{datetime.fromisoformat(end).astimezone():%H:%M}" for end in self.ends_utc)
        return f"{words}, ends {f'at {low}' if low == high else f'between {low} and {high}'}"

    @property
    def says(self) -> str:
        """Progress in words."""
        of = f" of {self.planned}" if self.planned is not None else ""
        ended = "" if self.finished else ", not finished"
        return f"{self.stage}: {self.shots}{of} shots{ended}, {moment(self.latest_utc)}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservedFile:
    """Imported file of observations."""

    name: str
    objects: dict[str, int]
    """Number of observations of each object."""

    @classmethod
    def of(cls, file: RecordedFile) -> Self:
        """Return what a file holds."""
        return cls(name=file.name, objects=dict(Counter(row.object for row in file.rows)))

    @property
    def says(self) -> str:
        """Contents in words."""
        return f"{self.name}: {', '.join(f'{n} of {name}' for name, n in self.objects.items())}"


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignStatus:
    """Status of a campaign, as `pkmcal status` shows it."""

    folder: str
    name: str
    robot: str
    phase: str
    """Stage that the campaign has reached, in words."""
    series: tuple[StageProgress, ...]
    """Progress of every series, the latest last."""
    observations: tuple[ObservedFile, ...]
    """Imported files of observations of other kinds than points, the latest last."""
    decision: Verdict | None
    """Verdict on the whole campaign; None before an identification."""
    validated: bool
    """Whether the robot was ever validated after calibration."""
    open: tuple[str, ...]
    """Series and loads that were begun and not ended, and files that cannot be read."""
    doubtful: tuple[str, ...]
    """Findings and checks against the result, in words."""
    next: NextStep | None
    measuring: Holder | None
    """Process that works on the campaign now."""
    records: int
    """Records of the journal."""
    digest: str
    """Digest of the journal's last record, which stands for all of them; empty without one."""


def folder_status(folder: CampaignFolder, now: datetime) -> CampaignStatus:
    """Return the status of a folder's campaign, by its journal alone if its program may not run.

    `now`, with its zone, is when the remaining shots begin. Raise `ConfigInvalid` or
    `JournalFailed` for files that cannot be read.
    """
    try:
        campaign = open_campaign(folder.folder)
    except ProgramUntrusted as error:
        return _status_of_journal(folder, error, now)
    return campaign_status(campaign, now)


def _status_of_journal(
    folder: CampaignFolder, error: ProgramUntrusted, now: datetime
) -> CampaignStatus:
    """Return what the journal states without the robot, whose program may not run."""
    series, records, digest, unended = tuple[StageProgress, ...](), 0, "", ""
    if folder.journal_path.exists():
        with folder.journal_reader() as journal:
            series = tuple(_progress(None, each, now) for each in journal.series())
            records, digest = journal.last_number(), journal.digest()
            unended = unended_load(journal, [])
    open_series = (f"series {each.series}, {each.says}" for each in series if not each.finished)
    return CampaignStatus(
        folder=str(folder.folder),
        name=folder.config.name,
        robot="robot not read",
        phase="not evaluated",
        series=series,
        observations=(),
        decision=None,
        validated=False,
        open=(*open_series, *filter(None, [unended]), error.problem),
        doubtful=(),
        next=NextStep(("trust", as_word(str(error.program.path))), "read it first"),
        measuring=lock_holder(folder.folder),
        records=records,
        digest=digest,
    )


def campaign_status(campaign: Campaign, now: datetime) -> CampaignStatus:
    """Return the status of a campaign; raise `JournalFailed` for a journal that cannot be read."""
    evaluation = evaluate(campaign)
    evidence, identification = evaluation.evidence, evaluation.evidence.identification
    state, worker = state_of(evaluation), lock_holder(campaign.folder)
    all_series = evidence.journal.series if evidence.journal else ()
    series = tuple(_progress(evidence.plan, each, now) for each in all_series)
    verdict = evaluation.verdict if identification is not None else None
    return CampaignStatus(
        folder=str(campaign.folder),
        name=campaign.config.name,
        robot=campaign.robot.name,
        phase=_doing(series) if worker and _doing(series) else phase(state),
        series=series,
        observations=tuple(map(ObservedFile.of, evidence.observations.files)),
        decision=verdict.decision if verdict else None,
        validated=evaluation.after is not None,
        open=tuple(_open(evidence, series)),
        doubtful=tuple(doubtful(evaluation)),
        next=next_hint(campaign, replace(state, worker=worker.says if worker else "")),
        measuring=worker,
        records=evidence.journal.records if evidence.journal else 0,
        digest=evidence.journal.digest if evidence.journal else "",
    )


def _doing(series: tuple[StageProgress, ...]) -> str:
    """Return what a process that works on the campaign measures now; "" if nothing is open."""
    return "" if not series or series[-1].finished else series[-1].doing


def phase(state: CampaignState) -> str:
    """Return the stage that a campaign has reached, in words."""
    # the latest stage first: a campaign that is validated is also identified, measured, planned
    if state.reported and state.after:
        return "validated and reported"
    if state.after:
        return "validated after calibration"
    if state.verdict is not None:
        is_calibrated = state.verdict == "pass" and state.holds
        return "calibrated, not validated" if is_calibrated else "identified"
    if state.measured:
        part = " in part" if state.unmeasured else ""
        return f"{'imported' if state.measured == 'import' else 'measured'}{part}, not identified"
    if state.before:
        return "validated before calibration"
    return "planned" if state.planned else "set up"


def _progress(plan: tuple[PlannedShot, ...] | None, series: Series, now: datetime) -> StageProgress:
    """Return the progress of a series by plan.csv; shots of a run's broken pairs do not count.

    When the run is resumed such a pair is measured again as a whole.
    """
    shots, planned = len(series.shots), series.started.planned
    if series.started.stage == "run" and plan is not None:
        planned = len(plan)
        if not plan_difference([shot.intent for shot in series.shots], plan):
            pending = resume_state(joint_steps(plan), series.shots).unmeasured
            shots = planned - sum(map(len, pending))
    return StageProgress(
        series=series.number,
        stage=series.started.stage,
        shots=shots,
        planned=planned,
        finished=series.finished,
        latest_utc=max((s.measured_utc for s in series.shots), default=series.started_utc),
        ends_utc=_ends(series, planned - shots, now) if planned and not series.finished else None,
    )


def _ends(series: Series, remaining: int, now: datetime) -> tuple[str, str] | None:
    """Return the earliest and the latest end by the pace of the last shots; None if unknown."""
    in_time = sorted(series.shots, key=lambda shot: shot.number)[-LATEST_SHOTS:]
    at = [datetime.fromisoformat(shot.measured_utc) for shot in in_time]
    gaps_s = [(after - before).total_seconds() for before, after in pairwise(at)]
    paces_s = [gap_s for gap_s in gaps_s if gap_s < LONGEST_PAUSE_S]
    interval_s = time_left_s(paces_s, remaining) if remaining > 0 else None
    if interval_s is None:
        return None
    low, high = ((now + timedelta(seconds=s)).isoformat(timespec="seconds") for s in interval_s)
    return low, high


def _open(evidence: Evidence, series: tuple[StageProgress, ...]) -> Iterator[str]:
    """Yield series and loads that were begun and not ended, and files that cannot be read."""
    latest = {each.stage: each for each in series}
    yield from (f"series {s.series}, {s.says}" for s in latest.values() if not s.finished)
    if evidence.journal and evidence.journal.unended_load:
        yield evidence.journal.unended_load
    yield from evidence.unreadable


def doubtful(evaluation: Evaluation) -> Iterator[str]:
    """Yield the findings that affect the verdict, a bad check, and statements that do not hold."""
    identification, check = evaluation.evidence.identification, evaluation.evidence.unanswered
    if identification is None:
        return
    if check is not None and check.decision != "fail":  # a failed one is among the checks below
        yield f"check, series {check.series}: {check.says}"
    against = (each for each in identification.judgement.findings if each.affects_verdict)
    yield from (finding.says for finding in against)
    broken = (each for each in evaluation.checks if each.holds is False)
    yield from (f"{each.denied} ({each.detail})" for each in broken)
