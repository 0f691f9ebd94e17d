"""Session: one series begun or resumed, what is missing measured, and closed."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from campaigns.journal import records
from campaigns.journal.journal import Journal, JournalReader
from campaigns.measuring import resume
from campaigns.measuring.engine import Engine
from campaigns.measuring.motion import Mover
from campaigns.measuring.run_state import PositionUncertainty, RunObserver, RunState, Wishes
from campaigns.measuring.series_log import SeriesLog, closing
from campaigns.measuring.stopping_rule import in_words, is_met
from campaigns.measuring.work import Cell, Session, Work
from campaigns.planning.steps import Group, shots_of
from campaigns.version import VERSION


@dataclass(frozen=True, slots=True)
class RunResult:
    """Result of a run: what was measured of its plan."""

    series: int
    shots: int
    left_out: int
    """Shots of the plan that were not taken: the goal was met without them."""
    goal_mm: float | None
    known: PositionUncertainty | None
    skipped: Mapping[tuple[int, ...], str] = field(default_factory=dict)
    """Shots that could not be measured, or should not be, and why."""
    settling: records.Event | None = None
    """Since which shot the robot has settled; None for too few visits of the drift pose."""

    @property
    def good(self) -> bool:
        """Return whether the goal is met, if there was one."""
        return self.goal_mm is None or is_met(self.goal_mm, self.known)


def run_result(journal: JournalReader, series: int, work: Work) -> RunResult:
    """Return the result of a series by what the journal holds of it.

    Of a group that was skipped more than once and is still missing, the latest reason is given.
    """
    measured = next(row for row in journal.series() if row.number == series)
    missing = resume.missing_shots(measured, work)
    events = [entry.record for entry in journal.records_of(records.Event, series)]
    latest = {event.shots: event for event in events if event.kind == "shot skipped"}
    skipped = {
        shots: event.text.partition(": ")[2]
        for shots, event in latest.items()
        if set(shots) <= set(missing)
    }
    left_out = len(missing) - sum(map(len, skipped))
    uncertainty = work.known_from(measured.shots)
    settling = next((event for event in reversed(events) if event.kind == "settling"), None)
    return RunResult(
        series, len(measured.shots), left_out, work.goal_mm, uncertainty, skipped, settling
    )


def measure_series(
    cell: Cell,
    journal: Journal,
    work: Work,
    observer: RunObserver,
    stop_requested: Callable[[], bool],
    *,
    anew: bool = False,
    wishes: Wishes | None = None,
) -> int:
    """Measure what the latest series of this stage still lacks, or a new one; return its number.

    `wishes`: what the operator asks for meanwhile.
    `anew` leaves an unfinished series as it is and begins another. Raise `ResumeRefused` when plan
    or devices are not those it began with, `Interrupted`, or whatever stopped the engine. At the
    end the journal is read back from the disk and verified.
    """
    robot, tracker = cell.robot.identity(), cell.tracker.identity()
    today = records.SeriesStarted(
        work.stage,
        work.plan_digest,
        work.configuration,
        VERSION,
        work.robot_file_digest,
        robot,
        tracker,
        cell.tracker.weather(),
        lacks=tuple(cell.robot.lacks(work.robot.kinematics.mechanism.parameters.optional)),
    )
    begun = None if anew else resume.series_to_take_up(journal, work)
    if begun is not None:
        resume.check_same_devices(begun, robot.serial, tracker.serial)
    series = begun.number if begun else journal.start_series(today)
    log = SeriesLog(journal, series, observer)
    resumed = resume.how_it_stopped(journal, series) if begun else ""
    beam = _beam_start(cell)
    log.write(records.SessionStarted(VERSION, robot, tracker, today.weather, beam))
    sessions = journal.records_of(records.SessionStarted, series)
    starts = [beam for entry in sessions if (beam := entry.record.beam) is not None]
    with closing(log):
        if resumed:
            log.write(records.Event("resumed", f"{work.stage} goes on after {resumed}"))
        state = resume.resume_state(work.steps, journal.shots(series))
        for half in state.halves:
            log.write(half)
        done, total = len(state.kept), len(work.steps)
        run_state = RunState(observer, done=done, total=total, goal_mm=work.goal_mm)
        mover = Mover(
            cell.robot, cell.clock, work.speed_fraction, work.settle, work.robot, stop_requested
        )
        session = Session(
            cell, work, log, run_state, work.gate_after(state.kept), mover, wishes or Wishes()
        )
        first_weather = (begun.started if begun else today).weather
        engine = Engine(session, starts, state, first_weather)
        wanted = engine.leave_out_superfluous(_without_skipped(session, state.left))
        if wanted and state.kept:  # has anything shifted since the last session?
            engine.check_unmoved()
        engine.run(wanted)
        if not (begun and begun.finished):  # one that ended early is finished already
            log.write(records.SeriesFinished())
    journal.prove()
    return series


def _without_skipped(session: Session, pending: Sequence[Group]) -> tuple[Group, ...]:
    """Return the groups that shall be measured; note the others in the journal."""
    skipped = session.work.skipped_groups
    for group in pending:
        if group in skipped:
            shots = shots_of(group)
            text = f"{in_words(shots)} skipped: left out by --skip"
            session.log.write(records.Event("shot skipped", text, shots))
    return tuple(group for group in pending if group not in skipped)


def _beam_start(cell: Cell) -> records.BeamStart | None:
    """Read where the robot stands and the beam points before anything moves."""
    direction, state = cell.tracker.direction(), cell.robot.state()
    if direction is None or state.moving:
        return None
    return records.BeamStart(state.joints, direction)
