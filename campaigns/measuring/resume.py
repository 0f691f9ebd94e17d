"""What an earlier session left of a series: whether and where it may go on."""

from collections.abc import Sequence
from dataclasses import dataclass

from campaigns.errors import ResumeRefused
from campaigns.journal.journal import JournalReader
from campaigns.journal.records import PairVoided, SessionStarted, SessionStopped
from campaigns.journal.views import AcceptedShot, Series
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plan_match import plan_difference
from campaigns.planning.steps import Group, Step, groups
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Vector3

REMEDY = "bring back what it began with, or begin anew with --anew"


@dataclass(frozen=True, slots=True)
class ResumeState:
    """What is there of a series, and what is still to be done."""

    kept: tuple[AcceptedShot, ...]
    halves: tuple[PairVoided, ...]
    """Pairs cut in two by the end of the session: their shots no longer count."""
    left: tuple[Group, ...]

    def first_drift_mm(self) -> Vector3 | None:
        """Where the drift pose was first."""
        drifts = [s for s in self.kept if s.intent.purpose == ShotSet.DRIFT.value]
        first = min(drifts, key=lambda shot: shot.number, default=None)
        return first.outcome.point_in_tracker_mm if first else None

    def reference(self, steps: Sequence[Step]) -> tuple[Step, Vector3] | None:
        """A step to repeat after a restart and where it was: the drift pose's first, else any.

        None when nothing has been measured that still counts.
        """
        was_mm = {s.intent.shot: s.outcome.point_in_tracker_mm for s in self.kept}
        taken = [step for step in steps if step.planned.shot in was_mm]
        drifts = [step for step in taken if step.planned.purpose is ShotSet.DRIFT]
        found = next(iter(drifts or taken), None)
        return (found, was_mm[found.planned.shot]) if found else None


def resume_state(steps: Sequence[Step], accepted: Sequence[AcceptedShot]) -> ResumeState:
    """Sort what has been accepted of these steps into whole groups and cut ones."""
    taken = {shot.intent.shot for shot in accepted}
    left = tuple(
        group for group in groups(steps) if any(step.planned.shot not in taken for step in group)
    )
    halves = tuple(half for group in left if (half := _half(group, taken)))
    voided = {shot for half in halves for shot in half.shots}
    kept = tuple(shot for shot in accepted if shot.intent.shot not in voided)
    return ResumeState(kept, halves, left)


def _half(group: Group, taken: set[int]) -> PairVoided | None:
    shots = tuple(step.planned.shot for step in group if step.planned.shot in taken)
    pair = group[0].planned.pair
    if not shots or pair is None:
        return None
    return PairVoided(pair, shots, "the session ended between the two shots of the pair")


def other_plan(
    series: Series,
    accepted: Sequence[AcceptedShot],
    planned: Sequence[PlannedShot],
    plan_digest: str,
) -> str:
    """How a plan is another one than that of a series, in words; empty when it is not.

    Only plan.csv, which a run measures, is edited by people: rows may go and come. Other stages
    make their plans themselves, and one of them is the same to the last digit or another one.
    """
    began = series.started
    if began.plan_digest == plan_digest:
        return ""
    if began.stage == "run":
        return plan_difference((shot.intent for shot in accepted), planned)
    return f"{began.plan_digest[:8]}…, now {plan_digest[:8]}…"


def check_same_robot(series: Series, robot_file_digest: str) -> None:
    """Raise `ResumeRefused` unless the parameter set is the one that the series began with."""
    then, now = series.started.robot_file_digest, robot_file_digest
    if then != now:
        raise refused(series, f"another parameter set ({then[:8]}…, now {now[:8]}…)")


def check_same_devices(
    series: Series, controller_serial: str | None, tracker_serial: str | None
) -> None:
    """Raise `ResumeRefused` unless both are those that it began with; None: nobody says which."""
    began = series.started
    for device, before, now in (
        ("controller", began.robot, controller_serial),
        ("tracker", began.tracker, tracker_serial),
    ):
        then = before.serial if before else "unknown"
        if now is not None and then != now:
            raise refused(series, f"the {device} of serial number {then}, now it is {now}")


def how_it_stopped(journal: JournalReader, series: int) -> str:
    """How the last session of a series ended."""
    records = [entry.record for entry in journal.records(series)]
    last = [record for record in records if isinstance(record, SessionStarted | SessionStopped)][
        -1:
    ]
    if last and isinstance(last[0], SessionStopped):
        return f"'{last[0].reason}'"
    return "a crash: the last session wrote no end"


def refused(series: Series, began_with: str) -> ResumeRefused:
    """Error that says with what else a series was begun."""
    return ResumeRefused(
        f"series {series.number} ({series.started.stage}) was begun with {began_with}",
        remedy=REMEDY,
    )
