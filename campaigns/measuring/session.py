"""Session: one series begun or resumed, what is missing measured, and closed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from campaigns.journal.journal import Journal, JournalReader
from campaigns.journal.records import (
    BeamStart,
    Event,
    SeriesFinished,
    SeriesStarted,
    SessionStarted,
)
from campaigns.journal.views import AcceptedShot, Series
from campaigns.measuring.engine import Engine, Monitors
from campaigns.measuring.monitors import DriftMonitor, TemperatureMonitor
from campaigns.measuring.motion import Mover
from campaigns.measuring.reacquisition import Reacquisition, distinct_starts
from campaigns.measuring.resume import (
    ResumeState,
    check_same_devices,
    check_same_robot,
    how_it_stopped,
    other_plan,
    refused,
    resume_state,
)
from campaigns.measuring.run_state import ParameterPrecision, RunObserver, RunState
from campaigns.measuring.series_log import SeriesLog, closing
from campaigns.measuring.shot_taker import ShotTaker
from campaigns.measuring.stopping_rule import PrecisionGoal, in_words, is_met
from campaigns.measuring.tracker_place import StationMonitor
from campaigns.measuring.work import Cell, Session, Work
from campaigns.planning.paths import PathCache
from campaigns.planning.steps import Group, shots_of, stops_of
from campaigns.version import VERSION
from drivers.values import Identity, Weather


@dataclass(frozen=True, slots=True)
class SkippedShots:
    """Shots of the plan that were not measured, and why."""

    shots: tuple[int, ...]
    reason: str


@dataclass(frozen=True, slots=True)
class RunResult:
    """What there is of a plan when its run is over."""

    series: int
    shots: int
    left_out: int
    """Shots of the plan that were not taken: the goal was met without them."""
    goal: PrecisionGoal | None
    known: ParameterPrecision | None
    skipped: tuple[SkippedShots, ...] = ()
    """Shots that could not be measured, or should not be."""

    @property
    def good(self) -> bool:
        """Whether the goal is met, if there was one."""
        return self.goal is None or is_met(self.goal, self.known)


def run_result(journal: JournalReader, series: int, work: Work) -> RunResult:
    """Result of a series by what the journal holds of it."""
    shots = journal.shots(series)
    missing = missing_shots(shots, work)
    skipped = _skipped(journal, series, missing)
    left_out = len(missing) - sum(len(each.shots) for each in skipped)
    known = precision_from(shots, work)
    return RunResult(series, len(shots), left_out, work.goal, known, skipped)


def _skipped(
    journal: JournalReader, series: int, missing: Sequence[int]
) -> tuple[SkippedShots, ...]:
    """The latest word about each group that was skipped and is still missing."""
    events = [entry.record for entry in journal.records_of(Event, series)]
    latest = {event.shots: event for event in events if event.kind == "shot skipped"}
    return tuple(
        SkippedShots(shots, event.text.partition(": ")[2])
        for shots, event in latest.items()
        if set(shots) <= set(missing)
    )


def measure_series(
    cell: Cell,
    journal: Journal,
    work: Work,
    observer: RunObserver,
    stop_requested: Callable[[], bool],
    *,
    anew: bool = False,
) -> int:
    """Measure what the latest series of this stage still lacks, or a new one; gives its number.

    `anew` leaves an unfinished series as it is and begins another. Raises `ResumeRefused` when plan
    or devices are not those it began with, `Interrupted`, or whatever stopped the engine. What the
    journal says afterwards is on the disk, opened anew and verified.
    """
    today = _start_record(cell, work)
    found = None if anew else series_to_take_up(journal, work)
    if found is not None:
        check_same_devices(found, _serial(today.robot), _serial(today.tracker))
    series = found.number if found else journal.start_series(today)
    log = SeriesLog(journal, series, observer)
    resumed = how_it_stopped(journal, series) if found else ""
    beam = _beam_start(cell)
    log.write(SessionStarted(VERSION, today.robot, today.tracker, today.weather, beam))
    starts = [entry.record.beam for entry in journal.records_of(SessionStarted, series)]
    with closing(log):
        if resumed:
            log.write(Event("resumed", f"{work.stage} goes on after {resumed}"))
        left = resume_state(work.steps, journal.shots(series))
        for half in left.halves:
            log.write(half)
        done, total = len(left.kept), len(work.steps)
        goal_mm = work.goal.std_mm if work.goal else None
        run_state = RunState(observer, done=done, total=total, goal_mm=goal_mm)
        ways = PathCache(work.robot, stops_of(left.left))
        mover = Mover(
            cell.robot, cell.clock, work.speed_fraction, work.settle, ways, stop_requested
        )
        session = Session(cell, work, log, run_state, work.gate_taught_by(left.kept), mover)
        began = found.started if found else today
        _measure(session, left, began.weather, distinct_starts(starts))
        if not (found and found.finished):  # one that ended early is finished already
            log.write(SeriesFinished())
    journal.prove()
    return series


def _measure(
    session: Session,
    found: ResumeState,
    first_weather: Weather | None,
    starts: Sequence[BeamStart],
) -> None:
    """Look whether anything has shifted since the last session, then measure what is left."""
    work = session.work
    reacquisition = Reacquisition(session, starts)
    shots = [step.planned for step in work.steps]
    monitors = Monitors(
        DriftMonitor(work.gate.drift_mm, found.first_drift_mm()),
        TemperatureMonitor(work.gate.temperature_change_degC, first_weather),
        work.precision_monitor(),
        StationMonitor(work.station, work.robot.kinematics, shots) if work.station else None,
    )
    engine = Engine(session, ShotTaker(session, reacquisition), reacquisition, monitors)
    wanted = engine.wanted(_without_skipped(session, found.left))
    if wanted and found.kept:
        engine.check_unmoved(found.reference(work.steps))
    engine.run(wanted)


def _without_skipped(session: Session, left: Sequence[Group]) -> tuple[Group, ...]:
    """Groups that shall be measured; the journal names the others."""
    skipped = session.work.skipped_groups
    for group in left:
        if group in skipped:
            shots = shots_of(group)
            text = f"{in_words(shots)} skipped: left out by --skip"
            session.log.write(Event("shot skipped", text, shots))
    return tuple(group for group in left if group not in skipped)


def complete_series(journal: JournalReader, work: Work) -> Series | None:
    """The latest series of this stage if it is finished and measured this very plan.

    To one that ended early something is left, unless it meets the goal of this work, or all that is
    left shall be skipped.
    """
    latest = journal.latest_series(work.stage)
    if latest is None or not latest.finished:
        return None
    shots = journal.shots(latest.number)
    if _other_plan(latest, shots, work):
        return None
    done = not _wanted_shots(shots, work) or (
        work.goal and is_met(work.goal, precision_from(shots, work))
    )
    return latest if done else None


def series_to_take_up(journal: JournalReader, work: Work) -> Series | None:
    """The series to go on with: an unfinished one, or one that lacks shots of this plan.

    Raises `ResumeRefused` when plan or parameters are not those it began with.
    """
    latest = journal.latest_series(work.stage)
    if latest is None:
        return None
    shots = journal.shots(latest.number)
    difference = _other_plan(latest, shots, work)
    if latest.finished and (difference or not missing_shots(shots, work)):
        return None
    if difference:
        raise refused(latest, f"another plan ({difference})")
    check_same_robot(latest, work.robot_file_digest)
    return latest


def missing_shots(shots: Sequence[AcceptedShot], work: Work) -> tuple[int, ...]:
    """Shots of the plan that are not among the accepted ones of its series, in their order."""
    taken = {shot.intent.shot for shot in shots}
    numbers = (step.planned.shot for step in work.steps)
    return tuple(number for number in numbers if number not in taken)


def _wanted_shots(shots: Sequence[AcceptedShot], work: Work) -> set[int]:
    """Missing shots that shall not be skipped."""
    skipped = {shot for group in work.skipped_groups for shot in shots_of(group)}
    return set(missing_shots(shots, work)) - skipped


def _other_plan(series: Series, shots: Sequence[AcceptedShot], work: Work) -> str:
    planned = [step.planned for step in work.steps]
    return other_plan(series, shots, planned, work.plan_digest)


def _serial(identity: Identity | None) -> str | None:
    return identity.serial if identity else None


def precision_from(shots: Sequence[AcceptedShot], work: Work) -> ParameterPrecision | None:
    """What the accepted shots of a series tell of the parameters, as `identify` will find it."""
    return work.precision_monitor().fitted(shot.outcome for shot in shots)


def _beam_start(cell: Cell) -> BeamStart | None:
    """Where the robot stands and the beam points before this session moves anything."""
    direction, state = cell.tracker.direction(), cell.robot.state()
    if direction is None or state.moving:
        return None
    return BeamStart(state.joints, direction)


def _start_record(cell: Cell, work: Work) -> SeriesStarted:
    """What a series that begins now would begin with: asks both devices who they are."""
    return SeriesStarted(
        work.stage,
        work.plan_digest,
        work.configuration,
        VERSION,
        work.robot_file_digest,
        cell.robot.identity(),
        cell.tracker.identity(),
        cell.tracker.weather(),
    )
