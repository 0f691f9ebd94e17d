"""Session: one series begun or resumed, what is missing measured, and closed."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import JsonValue

from campaigns.estimation.incremental_fit import IncrementalGaussNewton
from campaigns.estimation.variance_components import VarianceComponents
from campaigns.journal.journal import Journal, JournalReader
from campaigns.journal.records import (
    BeamStart,
    Event,
    Outcome,
    SeriesFinished,
    SeriesStarted,
    SessionStarted,
    Stage,
)
from campaigns.journal.views import AcceptedShot, Series
from campaigns.measuring.engine import Engine, Monitors
from campaigns.measuring.monitors import DriftMonitor, InnovationGate, TemperatureMonitor
from campaigns.measuring.motion import Mover
from campaigns.measuring.precision_monitor import PrecisionMonitor
from campaigns.measuring.reacquisition import Reacquisition, distinct_starts
from campaigns.measuring.reference_poses import (
    BodyComparison,
    ReferencePose,
    ReferenceScatter,
    compare_as_body,
    reference_poses,
)
from campaigns.measuring.resume import (
    ResumeState,
    check_same_devices,
    check_same_robot,
    how_it_stopped,
    other_plan,
    refused,
    resume_state,
)
from campaigns.measuring.rules import GateRules, MotionRules
from campaigns.measuring.run_state import ParameterPrecision, RunObserver, RunState
from campaigns.measuring.series_log import SeriesLog, closing
from campaigns.measuring.shot_taker import Cell, ShotTaker
from campaigns.measuring.stopping_rule import PrecisionGoal, in_words, is_met
from campaigns.measuring.tracker_place import PlaceMonitor, TrackerSight
from campaigns.planning.paths import PathCache, RobotModel
from campaigns.planning.predicted_precision import EstimationSetup
from campaigns.planning.steps import Group, Step, groups, shots_of, stops_of
from campaigns.version import VERSION
from drivers.values import Identity, Weather

WORKSPACE_SEED = 1
"""Positions are judged at the same poses in every session."""
UNKNOWN_SCATTER = 0.25
"""Standard deviation, in parts of the limit of drift, of a robot whose scatter nobody knows yet."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Work:
    """Work of a session: what is to be measured, and by which rules."""

    stage: Stage
    steps: tuple[Step, ...]
    plan_digest: str
    robot_file_digest: str
    configuration: Mapping[str, JsonValue]
    robot: RobotModel
    motion: MotionRules
    gate: GateRules
    setup: EstimationSetup
    """How the shots will be identified from, which says how much is known."""
    sight: TrackerSight | None = None
    """Where the tracker is said to stand; None: nobody said it."""
    goal: PrecisionGoal | None = None
    """Of what is identified; once it is met, only the other shots are taken."""
    skip: frozenset[int] = frozenset()
    """Shots that shall not be measured, nor the partners of their pairs."""
    anyway: bool = False
    """Whether to go on although poses have moved since the last session."""
    compared_at_end: bool = False
    """Whether spread poses are measured again at the end of a series that nothing interrupted."""

    @property
    def skipped_groups(self) -> tuple[Group, ...]:
        """Groups with a shot that shall not be measured."""
        return tuple(group for group in groups(self.steps) if self.skip & set(shots_of(group)))

    def knowing(self) -> PrecisionMonitor:
        """What tells how much is known of the parameters."""
        shots = [step.planned for step in self.steps]
        rng = np.random.default_rng(WORKSPACE_SEED)
        return PrecisionMonitor.of_plan(shots, self.robot, self.setup, rng)

    def watched_place(self) -> PlaceMonitor | None:
        """What compares the tracker's place with the shots, if anybody said where that is."""
        if self.sight is None:
            return None
        shots = [step.planned for step in self.steps]
        return PlaceMonitor(self.sight, self.robot.kinematics, shots)

    def scatter_by(self, outcomes: Sequence[Outcome]) -> ReferenceScatter:
        """Scatter of poses measured twice: the tracker's, and the robot's own by these shots.

        Too few to tell that let the robot scatter by a part of what drift shots may.
        """
        instrument, fit = self.setup.uncertainty, self.knowing().point_fit(outcomes)
        if fit is None:
            drift = VarianceComponents(point_mm=self.gate.drift_mm * UNKNOWN_SCATTER)
            return ReferenceScatter(drift, instrument, limit_mm=self.gate.drift_mm)
        noise = fit.found.noise
        return ReferenceScatter(
            fit.scatter, instrument, max(1.0, noise.birge_ratio or 1.0), noise.dof
        )

    def gate_taught_by(self, shots: Iterable[AcceptedShot]) -> InnovationGate:
        """A gate that knows these shots and no others.

        What `identify` is told to hold need not be right: the usual parameters are free here.
        """
        kinematics = self.robot.kinematics
        space = kinematics.mechanism.parameters
        wanted = {*space.free_by_default, *self.setup.free}
        free = tuple(name for name in space.geometry if name in wanted)
        gate = InnovationGate(self.gate, lambda: IncrementalGaussNewton(kinematics, free))
        for shot in shots:
            gate.accept(shot.outcome)
        return gate


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
    watcher: RunObserver,
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
    log = SeriesLog(journal, series)
    resumed = how_it_stopped(journal, series) if found else ""
    beam = _beam_start(cell)
    log.write(SessionStarted(VERSION, today.robot, today.tracker, today.weather, beam))
    starts = [entry.record.beam for entry in journal.records_of(SessionStarted, series)]
    with closing(log):
        if resumed:
            log.write(Event("resumed", f"{work.stage} goes on after {resumed}"))
        left = resume_state(work.steps, journal.shots(series))
        began = found.started if found else today
        ours = _Run(cell, log, work, watcher, stop_requested, distinct_starts(starts))
        ours.measure(left, began.weather)
        if not (found and found.finished):  # one that ended early is finished already
            log.write(SeriesFinished())
    journal.prove()
    return series


@dataclass(frozen=True, slots=True, eq=False)
class _Run:
    """One session's work on a series."""

    cell: Cell
    log: SeriesLog
    work: Work
    watcher: RunObserver
    stop_requested: Callable[[], bool]
    starts: Sequence[BeamStart]

    def measure(self, found: ResumeState, first_weather: Weather | None) -> None:
        """Void what was cut in two, look whether anything has shifted, then measure the rest."""
        for half in found.halves:
            self.log.write(half)
        gate = self.work.gate_taught_by(found.kept)
        engine = self._engine(found, first_weather, gate)
        wanted = engine.wanted(self._without_skipped(found.left))
        if wanted and found.kept:
            steps = self.work.steps
            references = reference_poses(steps, gate.accepted)
            engine.check_unmoved(references, found.reference(steps), anyway=self.work.anyway)
        engine.run(wanted, self._at_end)

    def _without_skipped(self, left: Sequence[Group]) -> tuple[Group, ...]:
        """Groups that shall be measured; the journal names the others."""
        skipped = self.work.skipped_groups
        for group in left:
            if group in skipped:
                shots = shots_of(group)
                text = f"{in_words(shots)} skipped: left out by --skip"
                self.log.write(Event("shot skipped", text, shots))
        return tuple(group for group in left if group not in skipped)

    def _at_end(self, accepted: Sequence[Outcome]) -> Sequence[ReferencePose]:
        """Poses that are compared at the end of a run that nothing has interrupted."""
        return reference_poses(self.work.steps, accepted) if self.work.compared_at_end else ()

    def _engine(
        self, found: ResumeState, first_weather: Weather | None, gate: InnovationGate
    ) -> Engine:
        cell, work = self.cell, self.work
        goal_mm = work.goal.std_mm if work.goal else None
        done, total = len(found.kept), len(work.steps)
        tally = RunState(self.watcher, done=done, total=total, goal_mm=goal_mm)
        ways = PathCache(work.robot, stops_of(found.left))
        mover = Mover(cell.robot, cell.clock, work.motion, ways, self.stop_requested)
        reacquisition = Reacquisition(
            cell.tracker, cell.clock, self.log, mover, gate, tally, work.gate, self.starts
        )
        shooter = ShotTaker(cell, self.log, mover, gate, tally, reacquisition)
        watches = Monitors(
            gate,
            DriftMonitor(work.gate.drift_mm, found.first_drift_mm()),
            TemperatureMonitor(work.gate.temperature_change_degC, first_weather),
            work.gate.attempts,
            work.knowing(),
            work.watched_place(),
            work.goal,
        )

        def compare(poses: Sequence[ReferencePose], now: Sequence[Outcome]) -> BodyComparison:
            kept, then = gate.accepted, [pose.then for pose in poses]
            scatter = work.scatter_by(kept)
            return compare_as_body(work.robot.kinematics, kept, then, now, scatter)

        plan = groups(work.steps)
        return Engine(cell, self.log, shooter, reacquisition, watches, tally, plan, compare)


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


def count_left_out(shots: Sequence[AcceptedShot], work: Work) -> int:
    """How many shots of the plan are not among the accepted ones of its series."""
    return len(missing_shots(shots, work))


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
    return work.knowing().fitted(shot.outcome for shot in shots)


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
