"""The run engine: one small loop over groups of shots. When anything goes wrong the robot stops."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from campaigns.errors import GateRefused
from campaigns.journal.records import Event, Outcome, PairVoided, Rejected
from campaigns.measuring.attempts import Attempts
from campaigns.measuring.body_check import ANEW, BodyCheck, BodyTest, drift_text
from campaigns.measuring.monitors import DriftMonitor, InnovationGate, TemperatureMonitor
from campaigns.measuring.precision_monitor import PrecisionMonitor
from campaigns.measuring.reacquisition import Reacquisition
from campaigns.measuring.reference_poses import ReferencePose
from campaigns.measuring.run_state import (
    AcceptedShotReport,
    EngineState,
    ParameterPrecision,
    RunState,
)
from campaigns.measuring.series_log import SeriesLog, problem_of
from campaigns.measuring.shot_taker import (
    Cell,
    ReflectorUnseen,
    ShotFailed,
    ShotRefused,
    ShotTaker,
    TargetRefused,
)
from campaigns.measuring.stopping_rule import PrecisionGoal, early_stop, in_words, may_stop
from campaigns.measuring.tracker_place import PlaceMonitor
from campaigns.measuring.wrong_targets import WrongTargets
from campaigns.planning.steps import Group, Step, shots_of
from campaigns.shots.shot_sets import ShotSet
from drivers.errors import RobotStateUnknown
from drivers.values import Vector3

MOST_IN_A_ROW = 3
"""Groups one after another that cannot be measured; then it is not the poses."""
MOST_SET_ASIDE = 0.2
"""Share of a plan's groups that cannot be measured and still let the run go on."""


@dataclass(frozen=True, slots=True)
class Monitors:
    """What the engine watches from shot to shot."""

    gate: InnovationGate
    drift: DriftMonitor
    air: TemperatureMonitor
    attempts: int
    knowing: PrecisionMonitor
    place: PlaceMonitor | None
    """None where nobody said where the tracker stands."""
    goal: PrecisionGoal | None
    """Once it is met, what only serves to identify is left out."""


class Engine:
    """Measures groups of steps: pairs whole or again, and everything watched."""

    def __init__(
        self,
        cell: Cell,
        log: SeriesLog,
        shooter: ShotTaker,
        reacquisition: Reacquisition,
        watches: Monitors,
        tally: RunState,
        plan: Sequence[Group],
        compare: BodyTest,
    ) -> None:
        self._cell = cell
        self._log = log
        self._shooter = shooter
        self._watches = watches
        self._tally = tally
        self._plan = plan
        self._attempts = Attempts(watches.attempts, reacquisition)
        self._wrong_targets = WrongTargets(
            watches.gate,
            shooter,
            reacquisition,
            self._attempts,
            step_of=self._step,
            void=self._void_first,
            allowed=watches.attempts,
        )
        self._body = BodyCheck(
            log, shooter, self._attempts, compare, watches.gate.distance_mm, watches.drift.limit_mm
        )
        self._references: tuple[ReferencePose, ...] = ()
        self._aside: list[Group] = []
        self._in_a_row = 0
        self._known: ParameterPrecision | None = None
        self._learn(self._running_knowledge())

    def wanted(self, left: Sequence[Group]) -> tuple[Group, ...]:
        """The groups that shall still be measured; the others are named in the journal."""
        goal = self._watches.goal
        if may_stop(goal, self._known, left):
            self._learn(self._knowledge_by_a_fit())
        end = early_stop(goal, self._known, left)
        if end is None:
            return tuple(left)
        self._announce(end.event)
        self._tally.leave_out(end.shots_left_out)
        return end.wanted

    def run(
        self,
        groups: Sequence[Group],
        at_end: Callable[[Sequence[Outcome]], Sequence[ReferencePose]] = lambda _: (),
    ) -> None:
        """Measure all groups; raises whatever made it stop, once the robot has been stopped.

        `at_end` chooses the poses that are compared once more when all is measured, where none were
        after a restart. `RobotStateUnknown` when the stop could not be confirmed.
        """
        self._guarded(lambda: self._measure_all(groups, at_end))

    def check_unmoved(
        self,
        references: Sequence[ReferencePose],
        alone: tuple[Step, Vector3] | None,
        *,
        anyway: bool,
    ) -> None:
        """Measure reference poses again after a restart, or where there are few, one `alone`.

        Raises `GateRefused` when something has changed, unless the operator goes on `anyway`: what
        was measured before then predicts nothing any more. Stops the robot like `run`.
        """
        self._guarded(lambda: self._refuse_change(references, alone, anyway=anyway))

    def _guarded(self, work: Callable[[], None]) -> None:
        try:
            work()
        except BaseException as error:
            self._stop(error)
            raise

    def _stop(self, because: BaseException) -> None:
        try:
            self._insist_on_stop()
        except BaseException as error:
            raise RobotStateUnknown(
                f"robot state unknown: the stop failed ({problem_of(error)}), "
                f"after: {problem_of(because)}",
                remedy="use the hardware stop",
            ) from error
        finally:
            self._tally.enter(EngineState.STOPPED)

    def _insist_on_stop(self) -> None:
        try:
            self._cell.robot.stop()
        except KeyboardInterrupt:  # an impatient operator: the robot comes first
            self._cell.robot.stop()

    def _measure_all(
        self,
        groups: Sequence[Group],
        at_end: Callable[[Sequence[Outcome]], Sequence[ReferencePose]],
    ) -> None:
        left = self.wanted(groups)
        while left:
            again = self._measured(left[0])
            left = self.wanted((*again, *left[1:]))
        for group in self.wanted(self._aside):
            self._measure_once_more(group)
        self._learn(self._knowledge_by_a_fit())
        if groups and (references := self._references or at_end(self._watches.gate.accepted)):
            news = self._body.at_end(references)
            if news:
                self._tally.event(news)
        self._tally.enter(EngineState.FINISHED)

    def _measured(self, group: Group) -> tuple[Group, ...]:
        """Measure a group, or set it aside; gives what is to be measured before the rest.

        That is nothing, unless an earlier shot was the wrong one: then its group, and this one.
        """
        try:
            self._attempts.insist(partial(self._measure_group, group))
        except GateRefused as error:
            lost = error.__cause__
            if not isinstance(lost, ShotFailed):
                raise
            if isinstance(lost, ShotRefused):
                before = self._wrong_targets.resolve(lost)
                if before is not None:
                    return (*before, group)
            self._set_aside(group, error, lost)
        else:
            self._in_a_row = 0
        return ()

    def _set_aside(self, group: Group, error: GateRefused, lost: ShotFailed) -> None:
        """Leave a group for the end; raises what was wrong when it is more than single poses."""
        self._aside.append(group)
        self._in_a_row += not isinstance(lost, ReflectorUnseen)
        most = max(MOST_IN_A_ROW, MOST_SET_ASIDE * len(self._plan))
        if self._in_a_row >= MOST_IN_A_ROW or len(self._aside) > most:
            if isinstance(lost, TargetRefused) and isinstance(lost.__cause__, Exception):
                raise lost.__cause__
            raise error
        shots = shots_of(group)
        text = f"{in_words(shots)} set aside, to be tried once more at the end: {error.problem}"
        self._announce(Event("shot skipped", text, shots))

    def _measure_once_more(self, group: Group) -> None:
        try:
            self._attempts.insist(partial(self._measure_group, group), allowed=1)
        except GateRefused as error:
            if not isinstance(error.__cause__, ShotFailed):
                raise
            shots = shots_of(group)
            self._announce(
                Event("shot skipped", f"{in_words(shots)} skipped: {error.problem}", shots)
            )

    def _void_first(self, wrong: Outcome, why: str) -> Group:
        """Void a shot, its pair with it, and name it to the operator; gives its group."""
        event = Event("shot voided", f"shot {wrong.shot} does not count: {why}")
        self._announce(event)
        group = next((g for g in self._plan if wrong.shot in shots_of(g)), ())
        self._watches.drift.forget(wrong.point_in_tracker_mm)
        counted = {outcome.shot for outcome in self._watches.gate.accepted}
        pair = group[0].planned.pair if group else None
        shots = tuple(shot for shot in shots_of(group) if shot in counted) or (wrong.shot,)
        self._void_shots(pair, shots, event.text)
        return group

    def _step(self, shot: int) -> Step | None:
        """The plan's step of a shot; None when its row was taken out since it was measured."""
        return next((s for g in self._plan for s in g if s.planned.shot == shot), None)

    def _measure_group(self, group: Group) -> None:
        """A pair or a single shot, as a whole."""
        taken: list[Step] = []
        try:
            for step in group:
                self._measure(step)
                taken.append(step)
        except ShotFailed as lost:
            self._void(taken, str(lost))
            raise

    def _measure(self, step: Step) -> None:
        started_s = self._cell.wall_clock.now_s()
        outcome = self._shooter.measure(step)
        drift_mm = self._drift_mm(outcome) if step.planned.purpose is ShotSet.DRIFT else None
        self._shooter.accept(outcome)
        if step.planned.purpose is ShotSet.IDENTIFICATION:
            self._learn(self._running_knowledge())
        seconds = self._cell.wall_clock.now_s() - started_s
        self._tally.accept(AcceptedShotReport(seconds, outcome.residual_mm, drift_mm))
        if news := self._watches.air.news(outcome.weather):
            self._announce(Event("temperature alarm", news))
        if self._watches.place is not None:
            for event in self._watches.place.news(self._watches.gate.accepted):
                self._announce(event)

    def _announce(self, event: Event) -> None:
        self._log.write(event)
        self._tally.event(event.text)

    def _void(self, taken: Sequence[Step], reason: str) -> None:
        """Shots of one group do not count: one without its partner."""
        if taken:
            shots = tuple(step.planned.shot for step in taken)
            self._void_shots(taken[0].planned.pair, shots, reason)

    def _void_shots(self, pair: int | None, shots: tuple[int, ...], reason: str) -> None:
        self._log.write(PairVoided(pair, shots, reason))
        self._watches.gate.forget(shots)
        self._learn(self._running_knowledge())
        self._tally.void(len(shots))

    def _running_knowledge(self) -> ParameterPrecision | None:
        """What the shots that count tell of the parameters, at once."""
        gate = self._watches.gate
        return self._watches.knowing.after(gate.accepted, gate.linearized)

    def _knowledge_by_a_fit(self) -> ParameterPrecision | None:
        """The same as `identify` will tell it, which takes a little time."""
        return self._watches.knowing.fitted(self._watches.gate.accepted)

    def _learn(self, known: ParameterPrecision | None) -> None:
        self._known = known
        self._tally.know(known)

    def _drift_mm(self, outcome: Outcome) -> float | None:
        """How far a drift shot is from the first one; one too far is rejected and ends the run."""
        moved_mm = self._watches.drift.moved_mm(outcome.point_in_tracker_mm)
        if moved_mm is not None:
            self._judge_drift(outcome, moved_mm)
        return moved_mm

    def _refuse_change(
        self,
        references: Sequence[ReferencePose],
        alone: tuple[Step, Vector3] | None,
        *,
        anyway: bool,
    ) -> None:
        change = ""
        if references:
            change = self._body.after_restart(references)
        elif alone is not None:
            change = self._body.of_one(*alone)
        if change and not anyway:
            raise GateRefused(change, remedy=ANEW)
        if change:
            self._announce(Event("gone on anyway", f"gone on all the same: {change}"))
            self._watches.gate.forget([shot.shot for shot in self._watches.gate.accepted])
            self._watches.drift.begin_anew()
            self._learn(None)
            return
        self._references = tuple(references)

    def _judge_drift(self, outcome: Outcome, moved_mm: float) -> None:
        limit_mm = self._watches.drift.limit_mm
        text = drift_text("the drift pose is", moved_mm, limit_mm)
        self._log.write(Event("drift check", f"shot {outcome.shot}: {text}"))
        if moved_mm <= limit_mm:
            return
        self._log.write(Rejected(outcome.shot, outcome.attempt, text, outcome))
        raise GateRefused(
            f"shot {outcome.shot}: {text}",
            remedy="the tracker, the robot or its base has moved: fix it, then begin anew "
            "with --anew",
        )
