"""Session: one process begins or resumes a series, measures what it lacks, and closes it.

Everything that a session must remember lies in the journal, nothing in memory or in files of its
own: resuming after a stop, a crash or a power cut is the same as beginning, with fewer groups left.

The order is what makes it safe. Devices are identified before anything is written, so that a
session on another robot or tracker leaves no trace in the series. What the robot and the beam look
like is read before anything moves. The session's start is written before the first motion, and its
end after the stop: a start without an end is the mark of a crash. A pair that the end of the last
session cut in two is voided, and measured again as a whole. If shots were kept, poses are measured
again before new ones are added to them, because something may have moved meanwhile. At the end the
journal is closed, read back from the disk and verified: only then is the series said to be
measured.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from campaigns.journal import records
from campaigns.journal.journal import Journal, JournalReader
from campaigns.journal.views import AcceptedShot
from campaigns.measuring import resume
from campaigns.measuring.engine import Engine
from campaigns.measuring.motion import Mover
from campaigns.measuring.run_state import PositionUncertainty, RunObserver, RunState, Wishes
from campaigns.measuring.series_log import SeriesLog, closing
from campaigns.measuring.stopping_rule import in_words, is_met
from campaigns.measuring.work import Devices, Session, Work
from campaigns.planning.steps import Group, shots_of
from campaigns.version import VERSION
from drivers.values import Identity


@dataclass(frozen=True, slots=True)
class RunResult:
    """Result of a run: the measured part of its plan."""

    series: int
    shots: int
    left_out: int
    """Number of the plan's shots that were not taken because the goal was met without them."""
    goal_mm: float | None
    uncertainty: PositionUncertainty | None
    """Uncertainty by the accepted shots; None for too few of them."""
    skipped: Mapping[tuple[int, ...], str] = field(default_factory=dict)
    """Reasons by the shots that could not be measured, or should not be."""
    settling: records.Event | None = None
    """Event that names the shots since which the robot has settled; None for too few of them."""
    changed: str = ""
    """How the robot itself has changed by its reference poses; "" if it has not."""

    @property
    def reaches_goal(self) -> bool:
        """Return whether the goal is met, if there was one."""
        return self.goal_mm is None or is_met(self.goal_mm, self.uncertainty)

    @property
    def good(self) -> bool:
        """Return whether the goal is met, if there was one, and the robot has not changed."""
        return self.reaches_goal and not self.changed


def run_result(journal: JournalReader, series: int, work: Work) -> RunResult:
    """Return the result of a series as the journal has it.

    A group may be skipped more than once; if it is still missing, the latest reason is given.
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
    uncertainty = work.uncertainty_from(measured.shots)
    settling = next((event for event in reversed(events) if event.kind == "settling"), None)
    # The latest session's comparison counts. One that has gone on anyway does so at its end.
    compared = [e for e in events if e.kind in {"robot changed", "gone on anyway", "resumed"}]
    changed = compared[-1].text if compared and compared[-1].kind == "robot changed" else ""
    return RunResult(
        series, len(measured.shots), left_out, work.goal_mm, uncertainty, skipped, settling, changed
    )


def measure_series(
    cell: Devices,
    journal: Journal,
    work: Work,
    observer: RunObserver,
    wishes: Wishes,
    *,
    anew: bool = False,
) -> int:
    """Measure what the latest series of this stage still lacks, or a new one; return its number.

    `anew` leaves an unfinished series as it is and begins another. Raise `ResumeRefused` if plan or
    devices are not those that the series began with, `Interrupted` if the operator stops the run,
    or the error that ended it.
    """
    # 1. Read the devices, choose the series, and refuse other devices than those of its beginning.
    robot, tracker = cell.robot.identity(), cell.tracker.identity()
    started_now = _describe_start(cell, work, robot, tracker)
    resumed = None if anew else resume.series_to_take_up(journal, work)
    if resumed is not None:
        resume.check_same_devices(resumed, robot.serial, tracker.serial)
    # 2. Write the session's start. What ended the session before is read first.
    number = resumed.number if resumed else journal.start_series(started_now)
    log = SeriesLog(journal, number, observer)
    how_it_stopped = resume.how_it_stopped(journal, number) if resumed else ""
    weather, beam = started_now.weather, _beam_start(cell)
    log.write(records.SessionStarted(VERSION, robot, tracker, weather, beam))
    sessions = journal.records_of(records.SessionStarted, number)
    beam_starts = [entry.record.beam for entry in sessions if entry.record.beam is not None]
    with closing(log):  # writes the session's end, whatever it is
        # 3. Take what the series has: whole groups are kept, halves of pairs voided.
        if resumed:
            log.write(records.Event("resumed", f"{work.stage} goes on after {how_it_stopped}"))
        state = resume.resume_state(work.steps, journal.shots(number))
        for half in state.halves:
            log.write(half)
        session = _make_session(cell, work, log, observer, wishes, state.kept)
        # The air is compared with that of the series' beginning, not of this session's.
        first_weather = resumed.started.weather if resumed else weather
        engine = Engine(session, beam_starts, state, first_weather)
        wanted = engine.leave_out_superfluous(_without_skipped(session, state.unmeasured))
        # 4. Compare poses with the last session's. Where nothing is left to measure, there is
        #    nothing to compare either.
        if wanted and state.kept:
            engine.check_unmoved()
        # 5. Measure the missing groups.
        engine.run(wanted)
        if not (resumed and resumed.finished):  # one that ended early is finished already
            log.write(records.SeriesFinished())
    # 6. Prove the journal after the session's end, so that this record is proved, too.
    journal.prove()
    return number


def _describe_start(
    cell: Devices, work: Work, robot: Identity, tracker: Identity
) -> records.SeriesStarted:
    """Describe a series of this work that begins now on these devices."""
    return records.SeriesStarted(
        work.stage,
        work.plan_digest,
        work.configuration,
        VERSION,
        work.robot_file_digest,
        robot,
        tracker,
        cell.tracker.weather(),
        lacks=tuple(cell.robot.lacks(work.robot.kinematics.mechanism.parameters.optional)),
        planned=len(work.steps),
    )


def _make_session(
    cell: Devices,
    work: Work,
    log: SeriesLog,
    observer: RunObserver,
    wishes: Wishes,
    kept: Sequence[AcceptedShot],
) -> Session:
    """Return a session whose display and gate begin with the shots that the series has."""
    done, total = len(kept), len(work.steps)
    run_state = RunState(observer, done=done, total=total, goal_mm=work.goal_mm)
    speed, stop_requested = work.rules.speed_fraction, wishes.stop_requested
    mover = Mover(cell.robot, cell.clock, speed, work.rules.settle, work.robot, stop_requested)
    gate = work.gate_after(kept)
    gate.reflector = log.reflector
    return Session(cell, work, log, run_state, gate, mover, wishes)


def _without_skipped(session: Session, pending: Sequence[Group]) -> tuple[Group, ...]:
    """Return the groups that shall be measured; note the others in the journal."""
    skipped = session.work.skipped_groups
    for group in pending:
        if group in skipped:
            shots = shots_of(group)
            text = f"{in_words(shots)} skipped: left out by --skip"
            session.log.write(records.Event("shot skipped", text, shots))
    return tuple(group for group in pending if group not in skipped)


def _beam_start(cell: Devices) -> records.BeamStart | None:
    """Read where the robot stands and the beam points before anything moves."""
    # The operator has put the beam onto the robot's reflector there: a place to come back to when
    # it is lost and no shot has been accepted yet.
    direction, state = cell.tracker.direction(), cell.robot.state()
    if direction is None or state.moving:
        return None
    return records.BeamStart(state.joints, direction)
