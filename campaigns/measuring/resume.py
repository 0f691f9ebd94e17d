"""What an earlier session left of a series: whether and where it may go on."""

from collections.abc import Sequence
from dataclasses import dataclass

from campaigns.errors import ResumeRefused
from campaigns.journal.journal import JournalReader
from campaigns.journal.records import PairVoided, SeriesStarted, SessionStarted, SessionStopped
from campaigns.journal.views import AcceptedShot, Series
from campaigns.planning.steps import Group, Step, groups
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Identity, Vector3

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


def check_same(series: Series, today: SeriesStarted) -> None:
    """Raise `ResumeRefused` unless plan, parameters and devices are those it began with.

    `today` is what the series would begin with now.
    """
    began = series.started
    for what, then, now in (
        ("another plan", began.plan_digest, today.plan_digest),
        ("another parameter set", began.robot_file_digest, today.robot_file_digest),
    ):
        if then != now:
            raise _refused(series, f"{what} ({then[:8]}…, now {now[:8]}…)")
    for device, before, present in (
        ("controller", began.robot, today.robot),
        ("tracker", began.tracker, today.tracker),
    ):
        if _serial(before) != _serial(present):
            raise _refused(
                series,
                f"the {device} of serial number {_serial(before)}, now it is {_serial(present)}",
            )


def how_it_stopped(journal: JournalReader, series: int) -> str:
    """How the last session of a series ended."""
    records = [entry.record for entry in journal.records(series)]
    last = [record for record in records if isinstance(record, SessionStarted | SessionStopped)][
        -1:
    ]
    if last and isinstance(last[0], SessionStopped):
        return f"'{last[0].reason}'"
    return "a crash: the last session wrote no end"


def _serial(identity: Identity | None) -> str:
    return identity.serial if identity else "unknown"


def _refused(series: Series, began_with: str) -> ResumeRefused:
    return ResumeRefused(
        f"series {series.number} ({series.started.stage}) was begun with {began_with}",
        remedy=REMEDY,
    )
