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
from campaigns.measuring.run_state import (
    AcceptedShotReport,
    EngineState,
    ParameterPrecision,
    RunState,
)
from campaigns.measuring.series_log import SeriesLog, problem_of
from campaigns.measuring.shot_taker import Cell, ShotFailed, ShotTaker
from campaigns.measuring.stopping_rule import PrecisionGoal, early_stop, may_stop
from campaigns.planning.steps import Group, Step
from campaigns.shots.shot_sets import ShotSet
from drivers.errors import RobotStateUnknown
from drivers.values import Vector3

Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Monitors:
    """What the engine watches from shot to shot."""

    gate: InnovationGate
    drift: DriftMonitor
    air: TemperatureMonitor
    attempts: int
    knowing: PrecisionMonitor
    goal: PrecisionGoal | None
    """Once it is met, what only serves to identify is left out."""


class Engine:
    """Measures groups of steps: pairs whole or again, and everything watched."""

    def __init__(
        self, cell: Cell, log: SeriesLog, shooter: ShotTaker, watches: Monitors, tally: RunState
    ) -> None:
        self._cell = cell
        self._log = log
        self._shooter = shooter
        self._watches = watches
        self._tally = tally
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
        self._log.write(end.event)
        self._tally.event(end.event.text)
        self._tally.leave_out(end.shots_left_out)
        return end.wanted

    def run(self, groups: Sequence[Group]) -> None:
        """Measure all groups; raises whatever made it stop, once the robot has been stopped.

        `RobotStateUnknown` when that could not be confirmed.
        """
        self._guarded(lambda: self._measure_all(groups))

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
            self._insist(partial(self._measure_group, left[0]))
            left = self.wanted(left[1:])
        self._learn(self._knowledge_by_a_fit())
        self._tally.enter(EngineState.FINISHED)

    def _insist(self, attempt: Callable[[], Result]) -> Result:
        """Try as often as is allowed; raises `GateRefused` when no attempt gave data."""
        reasons: list[str] = []
        for _ in range(self._watches.attempts):
            try:
                return attempt()
            except ShotFailed as lost:
                reasons.append(str(lost))
        raise GateRefused(
            f"{len(reasons)} attempts failed, the last one: {reasons[-1]}",
            remedy="look at the reflector, the beam and the robot there; then run again, it "
            "resumes. If an earlier shot took the wrong reflector: begin anew with --anew",
        )

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
            self._log.write(Event("temperature alarm", news))
            self._tally.event(news)

    def _void(self, taken: Sequence[Step], reason: str) -> None:
        """The other shot of a pair does not count without its partner."""
        if not taken:
            return
        pair = taken[0].planned.pair
        assert pair is not None, "only pairs have more than one step"
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

    def _compare(self, step: Step, first_mm: Vector3) -> None:
        outcome = self._insist(lambda: self._shooter.measure(step))
        moved_mm = dist(first_mm, outcome.point_in_tracker_mm)
        self._judge_drift(outcome, moved_mm, "after the restart the pose is")
        reason = f"only compared with the first one, {moved_mm:.3f} mm away"
        self._log.write(Rejected(outcome.shot, outcome.attempt, reason, outcome))
        self._tally.enter(EngineState.IDLE)

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
