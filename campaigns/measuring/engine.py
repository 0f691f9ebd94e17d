"""The run engine: one small loop over groups of shots. When anything goes wrong the robot stops."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import dist
from typing import TypeVar

from campaigns.errors import GateRefused
from campaigns.journal.records import Event, Outcome, PairVoided, Rejected
from campaigns.measuring.monitors import DriftMonitor, InnovationGate, TemperatureMonitor
from campaigns.measuring.precision_monitor import PrecisionMonitor
from campaigns.measuring.reference_poses import BodyComparison, ReferencePose
from campaigns.measuring.run_state import (
    AcceptedShotReport,
    EngineState,
    ParameterPrecision,
    RunState,
)
from campaigns.measuring.series_log import SeriesLog, problem_of
from campaigns.measuring.shot_taker import Cell, ShotFailed, ShotTaker
from campaigns.measuring.stopping_rule import PrecisionGoal, early_stop, in_ranges, may_stop
from campaigns.measuring.tracker_place import PlaceMonitor
from campaigns.planning.steps import Group, Step
from campaigns.shots.shot_sets import ShotSet
from drivers.errors import RobotStateUnknown
from drivers.values import Vector3

Result = TypeVar("Result")
BodyTest = Callable[[Sequence[Outcome]], BodyComparison]
"""What outcomes of the reference poses, in their order, say of tracker and robot."""
SUSPECTS = 3
"""First shots that are measured again when a later one contradicts them."""


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
        watches: Monitors,
        tally: RunState,
        plan: Sequence[Group],
    ) -> None:
        self._cell = cell
        self._log = log
        self._shooter = shooter
        self._watches = watches
        self._tally = tally
        self._plan = plan
        self._looked_at_again: set[int] = set()
        self._references: tuple[ReferencePose, ...] = ()
        self._compare_body: BodyTest | None = None
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

    def run(self, groups: Sequence[Group]) -> None:
        """Measure all groups; raises whatever made it stop, once the robot has been stopped.

        `RobotStateUnknown` when that could not be confirmed.
        """
        self._guarded(lambda: self._measure_all(groups))

    def check_body(self, references: Sequence[ReferencePose], compare: BodyTest) -> None:
        """Measure reference poses again after a restart; raises `GateRefused` when some have moved.

        And once more when all is measured; then the operator is told. These shots are kept in the
        journal, but are none of the plan's. Stops the robot like `run`.
        """
        self._references, self._compare_body = tuple(references), compare
        self._guarded(self._refuse_changed_body)

    def check_place(self, step: Step, first_mm: Vector3) -> None:
        """Measure a step again after a restart; raises `GateRefused` when the point has moved.

        The shot is kept in the journal, but is none of the plan's. Stops the robot like `run`.
        """
        self._guarded(lambda: self._compare(step, first_mm))

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

    def _measure_all(self, groups: Sequence[Group]) -> None:
        left = self.wanted(groups)
        while left:
            again = self._measured(left[0])
            left = self.wanted((*again, *left[1:]))
        self._learn(self._knowledge_by_a_fit())
        if compared := self._body():
            event = Event("drift check", f"at the end {compared.text}")
            self._log.write(event)
            if compared.change:
                self._tally.event(event.text)
        self._tally.enter(EngineState.FINISHED)

    def _insist(self, attempt: Callable[[], Result]) -> Result:
        """Try as often as is allowed; raises `GateRefused` when no attempt gave data."""
        failures: list[ShotFailed] = []
        for _ in range(self._watches.attempts):
            try:
                return attempt()
            except ShotFailed as lost:
                failures.append(lost)
        raise GateRefused(
            f"{len(failures)} attempts failed, the last one: {failures[-1]}",
            remedy="look at the reflector, the beam and the robot there; then run again, it "
            "resumes. If an earlier shot took the wrong reflector: begin anew with --anew",
        ) from failures[-1]

    def _measured(self, group: Group) -> tuple[Group, ...]:
        """Measure a group; gives what is to be measured before the rest.

        That is nothing, unless an earlier shot was the wrong one: then its group, and this one.
        """
        try:
            self._insist(partial(self._measure_group, group))
        except GateRefused as error:
            lost = error.__cause__
            if not isinstance(lost, ShotFailed) or lost.refused is None:
                raise
            self._refuse_standing(lost.refused)
            wrong = self._wrong_first_shot(lost.refused)
            if wrong is None:
                raise
            return wrong, group
        return ()

    def _refuse_standing(self, refused: Outcome) -> None:
        """Void shots of a reflector that stands still; raises `GateRefused` when there are any."""
        standing = self._watches.gate.standing(refused)
        if not standing:
            return
        shots = sorted((*(each.shot for each in standing), refused.shot))
        text = f"shots {in_ranges(shots)} have one point, although the robot moved between them"
        for each in standing:
            self._void_first(each, f"{text}: a reflector that stands elsewhere")
        raise GateRefused(
            f"{text}: the tracker is on a reflector that stands elsewhere",
            remedy="put the beam onto the robot's reflector by hand, cover the other one, then run "
            "again: it resumes",
        )

    def _wrong_first_shot(self, refused: Outcome) -> Group | None:
        """The group of a first shot that is wrong, voided, if it is not the refused one that is.

        Whoever may be it is measured again: once each, and the three likeliest only.
        """
        gate = self._watches.gate
        for suspect in gate.suspects(refused)[:SUSPECTS]:
            if suspect.shot in self._looked_at_again:
                continue
            self._looked_at_again.add(suspect.shot)
            step = self._step(suspect.shot)
            again = self._insist(partial(self._shooter.look, step))
            away_mm = _away_mm(suspect, again)
            self._shooter.put_aside(
                again, f"only compared with the one before, {away_mm:.3f} mm away"
            )
            if gate.is_replaced(suspect, again, refused):
                return self._void_first(
                    suspect,
                    f"a wrong target or a wrong pose: measured again it is {away_mm:.1f} mm away, "
                    f"where shot {refused.shot} agrees with it",
                )
        return None

    def _void_first(self, wrong: Outcome, why: str) -> Group:
        """Void a shot, its pair with it, and name it to the operator; gives its group."""
        event = Event("shot voided", f"shot {wrong.shot} does not count: {why}")
        self._announce(event)
        group = next(group for group in self._plan if self._step(wrong.shot) in group)
        counted = {outcome.shot for outcome in self._watches.gate.accepted}
        self._watches.drift.forget(wrong.point_in_tracker_mm)
        self._void([step for step in group if step.planned.shot in counted], event.text)
        return group

    def _step(self, shot: int) -> Step:
        return next(s for group in self._plan for s in group if s.planned.shot == shot)

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
        """Shots of one group do not count: one without its partner, or what turned out wrong."""
        if not taken:
            return
        pair = taken[0].planned.pair
        shots = tuple(step.planned.shot for step in taken)
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
            self._judge_drift(outcome, moved_mm, "the drift pose is")
        return moved_mm

    def _refuse_changed_body(self) -> None:
        compared = self._body()
        if compared is None:
            return
        self._log.write(Event("drift check", f"after the restart {compared.text}"))
        if compared.change:
            raise GateRefused(
                f"after the restart {compared.text}",
                remedy="what had been measured does not go with what would come: mend it, then "
                "begin anew with --anew",
            )

    def _body(self) -> BodyComparison | None:
        """Reference poses measured again and compared; None when there are none."""
        if not self._references or self._compare_body is None:
            return None
        return self._compare_body([self._measured_again(each) for each in self._references])

    def _measured_again(self, reference: ReferencePose) -> Outcome:
        """Outcome of a reference pose, even one that the gate refuses each time for its place.

        One beyond the gate of distances is a wrong target: raises `GateRefused`.
        """
        try:
            outcome = self._insist(partial(self._shooter.measure, reference.step))
        except GateRefused as error:
            lost = error.__cause__
            if not isinstance(lost, ShotFailed) or lost.refused is None:
                raise
            if _away_mm(reference.then, lost.refused) > self._watches.gate.distance_mm:
                raise
            return lost.refused  # the journal has it already
        away_mm = _away_mm(reference.then, outcome)
        self._shooter.put_aside(outcome, f"only compared with the first one, {away_mm:.3f} mm away")
        return outcome

    def _compare(self, step: Step, first_mm: Vector3) -> None:
        outcome = self._insist(lambda: self._shooter.measure(step))
        moved_mm = dist(first_mm, outcome.point_in_tracker_mm)
        self._judge_drift(outcome, moved_mm, "after the restart the pose is")
        self._shooter.put_aside(
            outcome, f"only compared with the first one, {moved_mm:.3f} mm away"
        )

    def _judge_drift(self, outcome: Outcome, moved_mm: float, what: str) -> None:
        limit_mm = self._watches.drift.limit_mm
        text = f"{what} {moved_mm:.3f} mm from where it was first, limit {limit_mm:g} mm"
        self._log.write(Event("drift check", f"shot {outcome.shot}: {text}"))
        if moved_mm <= limit_mm:
            return
        self._log.write(Rejected(outcome.shot, outcome.attempt, text, outcome))
        raise GateRefused(
            f"shot {outcome.shot}: {text}",
            remedy="the tracker, the robot or its base has moved: fix it, then begin anew "
            "with --anew",
        )


def _away_mm(then: Outcome, now: Outcome) -> float:
    return dist(then.point_in_tracker_mm, now.point_in_tracker_mm)
