"""Resume: what a series has already, and whether and where it may go on.

Resuming is reading. The plan is compared with the accepted shots of the series in the journal, and
the groups that lack a shot are what is left to measure. No state of a run is kept beside the
journal, so that a stop, a crash, a power cut and a new plan row are all the same case.

All shots of a series are fitted as one robot seen by one tracker. A series therefore goes on only
with the plan, the parameter file, the controller and the tracker that it began with; otherwise it
is refused, and the user brings those back or begins a new series. Whether stand or robot has moved
in between cannot be read, it is measured (`Engine.check_unmoved`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

from campaigns.errors import ResumeRefused
from campaigns.journal.journal import JournalReader
from campaigns.journal.records import PairVoided, SessionStarted, SessionStopped
from campaigns.journal.views import AcceptedShot, Series
from campaigns.measuring.stopping_rule import is_met
from campaigns.measuring.work import Work
from campaigns.planning.plan_file import plan_difference
from campaigns.planning.steps import Group, Step, groups, shots_of
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Vector3

REMEDY = "bring back what it began with, or start a new series with --anew"


@dataclass(frozen=True, slots=True)
class ResumeState:
    """Shots that a series has, and groups that are still to be measured."""

    kept: tuple[AcceptedShot, ...]
    halves: tuple[PairVoided, ...]
    """Pairs cut in two by the end of the session: their shots no longer count."""
    unmeasured: tuple[Group, ...]
    """Groups to measure, those of the halves among them."""

    def first_drift_mm(self) -> dict[str, Vector3]:
        """Return the point of the first drift shot of each reflector, by its name."""
        # The first by its place in the journal, not by its stamp: the clock may have been set back.
        # A dict keeps the last of equal keys.
        drifts = [s for s in self.kept if s.intent.purpose == ShotSet.DRIFT.value]
        drifts.sort(key=lambda shot: shot.number, reverse=True)
        outcomes = [shot.outcome for shot in drifts]
        return {outcome.reflector: outcome.point_in_tracker_mm for outcome in outcomes}


def resume_state(steps: Sequence[Step], accepted: Sequence[AcceptedShot]) -> ResumeState:
    """Sort the accepted shots of these steps into whole groups and halves of pairs."""
    # The two shots of a pair are compared with each other: they have to be of one time and one
    # state of the cell, not of two sessions. So a half is voided, and its pair measured again.
    taken = {shot.intent.shot for shot in accepted}
    unmeasured = tuple(group for group in groups(steps) if not set(shots_of(group)) <= taken)
    reason = "the session ended between the two shots of the pair"
    cut = (
        (group[0].planned.pair, tuple(shot for shot in shots_of(group) if shot in taken))
        for group in unmeasured
    )
    halves = tuple(
        PairVoided(pair, shots, reason) for pair, shots in cut if shots and pair is not None
    )
    voided = {shot for half in halves for shot in half.shots}
    kept = tuple(shot for shot in accepted if shot.intent.shot not in voided)
    return ResumeState(kept, halves, unmeasured)


def missing_shots(series: Series, work: Work) -> tuple[int, ...]:
    """Return the plan's shots that are not accepted in its series, in the plan's order."""
    taken = {shot.intent.shot for shot in series.shots}
    numbers = (step.planned.shot for step in work.steps)
    return tuple(number for number in numbers if number not in taken)


def complete_series(journal: JournalReader, work: Work) -> Series | None:
    """Return the latest series of this stage if it is finished and measured this very plan.

    A series that ended early counts only if it meets the goal of this work, or if the
    operator skips all the shots that it lacks (`skipped_groups`).
    """
    latest = journal.latest_series(work.stage)
    if latest is None or not latest.finished or _plan_difference(latest, work):
        return None
    skipped = {shot for group in work.skipped_groups for shot in shots_of(group)}
    if set(missing_shots(latest, work)) <= skipped:
        return latest
    if work.goal_mm is None or not is_met(work.goal_mm, work.uncertainty_from(latest.shots)):
        return None
    return latest


def series_to_take_up(journal: JournalReader, work: Work) -> Series | None:
    """Return the series to go on with: an unfinished one, or one that lacks shots of this plan.

    None: a new series begins. Raise `ResumeRefused` if plan or parameters are not those that the
    series began with.
    """
    # A finished series with another plan is history: the new plan gets a series of its own. An
    # unfinished one with another plan is a mistake that only the user can resolve.
    latest = journal.latest_series(work.stage)
    if latest is None or latest.started.imported:
        return None
    difference = _plan_difference(latest, work)
    if latest.finished and (difference or not missing_shots(latest, work)):
        return None
    if difference:
        raise _refusal(latest, f"another plan ({difference})")
    then, now = latest.started.robot_file_digest, work.robot_file_digest
    if then != now:
        raise _refusal(latest, f"another parameter set ({then[:8]}…, now {now[:8]}…)")
    return latest


def check_same_devices(
    series: Series, controller_serial: str | None, tracker_serial: str | None
) -> None:
    """Raise `ResumeRefused` unless both devices are those that the series began with.

    A serial number of None is not compared: the device was not asked yet, or states none.
    """
    began = series.started
    for device, before, now in (
        ("controller", began.robot, controller_serial),
        ("tracker", began.tracker, tracker_serial),
    ):
        then = before.serial if before else "unknown"
        if now is not None and then != now:
            raise _refusal(series, f"the {device} of serial number {then}, now it is {now}")


def how_it_stopped(journal: JournalReader, series: int) -> str:
    """Return how the last session of a series ended, in words."""
    # A session that ends in order writes so. The last record being a start is the mark of a crash.
    records = [entry.record for entry in journal.records(series)]
    sessions = [row for row in records if isinstance(row, SessionStarted | SessionStopped)]
    if sessions and isinstance(sessions[-1], SessionStopped):
        return f"'{sessions[-1].reason}'"
    return "a crash: the last session wrote no end"


def _plan_difference(series: Series, work: Work) -> str:
    """Return how the plan differs from that of a series, in words; "" if it does not."""
    # Only plan.csv, which a run measures, is edited by people: rows may be added or removed, as
    # long as those of measured shots stay as they were. Other stages compute their plans, which are
    # therefore equal to the last digit or other plans.
    began = series.started
    if began.plan_digest == work.plan_digest:
        return ""
    if began.stage == "run":
        planned = [step.planned for step in work.steps]
        return plan_difference((shot.intent for shot in series.shots), planned)
    return f"{began.plan_digest[:8]}…, now {work.plan_digest[:8]}…"


def _refusal(series: Series, began_with: str) -> ResumeRefused:
    return ResumeRefused(
        f"series {series.number} ({series.started.stage}) was begun with {began_with}",
        remedy=REMEDY,
        options="--anew",
    )
