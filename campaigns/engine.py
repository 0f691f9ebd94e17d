"""The run engine: one small loop over groups of shots. Whatever goes wrong, the robot is stopped first."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from campaigns.errors import GateRefused
from campaigns.guards import moved_mm, temperature_alarm
from campaigns.progress import EngineState
from campaigns.records import Event, Outcome, PairVoided, Rejected
from campaigns.rules import GateRules
from campaigns.shooting import Cell, Shooter, ShotLost
from campaigns.shot_sets import ShotSet
from campaigns.steps import Group, Step
from campaigns.tally import ShotNews, Tally
from drivers.errors import DriverError, RobotStateUnknown
from drivers.values import Vector3, Weather


@dataclass(frozen=True, slots=True)
class Memory:
    """What a run compares its shots with: the first of its series, from whatever session."""

    first_drift_mm: Vector3 | None = None
    first_weather: Weather | None = None


class Engine:
    """Measures groups of steps: pairs whole or again, and everything watched."""

    def __init__(
        self, cell: Cell, shooter: Shooter, rules: GateRules, tally: Tally, memory: Memory
    ) -> None:
        self._cell = cell
        self._shooter = shooter
        self._rules = rules
        self._tally = tally
        self._first_drift_mm = memory.first_drift_mm
        self._first_weather = memory.first_weather
        self._alarm = ""

    def run(self, groups: Sequence[Group]) -> None:
        """Measure all groups; raises whatever made it stop, once the robot has been stopped.

        `RobotStateUnknown` when that could not be confirmed.
        """
        self._tally.expect(sum(len(group) for group in groups))
        self._guarded(lambda: self._measure_all(groups))

    def check_drift(self, step: Step) -> None:
        """Measure the drift pose again after a restart; raises `GateRefused` when it has moved.

        The shot is kept in the journal, but is none of the plan's.
        """
        self._guarded(lambda: self._compare_drift(step))

    def _guarded(self, work: Callable[[], None]) -> None:
        try:
            work()
        except BaseException as error:
            self._stop(error)
            raise

    def _stop(self, because: BaseException) -> None:
        try:
            self._cell.robot.stop()
        except DriverError as error:
            raise RobotStateUnknown(
                f"the robot could not be stopped ({error.problem}) after: {because}",
                remedy="robot state unknown: use the hardware stop",
            ) from because
        finally:
            self._tally.enter(EngineState.STOPPED)

    def _measure_all(self, groups: Sequence[Group]) -> None:
        for group in groups:
            self._measure_group(group)
        self._tally.enter(EngineState.FINISHED)

    def _measure_group(self, group: Group) -> None:
        """A pair or a single shot, as a whole, as often as it takes and is allowed."""
        reasons: list[str] = []
        while len(reasons) < self._rules.attempts:
            taken: list[Step] = []
            try:
                for step in group:
                    self._take(step)
                    taken.append(step)
            except ShotLost as lost:
                reasons.append(str(lost))
                self._void(taken, str(lost))
            else:
                return
        raise GateRefused(
            f"shot {group[-1].planned.shot} failed {len(reasons)} times, last: {reasons[-1]}",
            remedy="look at the reflector, the beam and the robot there; the next run resumes",
        )

    def _take(self, step: Step) -> None:
        started_s = self._cell.wall_clock.now_s()
        outcome = self._shooter.take(step)
        drift = self._drift_mm(outcome) if step.planned.purpose is ShotSet.DRIFT else None
        seconds = self._cell.wall_clock.now_s() - started_s
        self._tally.accept(ShotNews(seconds, outcome.residual_mm, drift))
        self._watch_weather(outcome.weather)
        if drift is not None:
            self._judge_drift(drift)

    def _void(self, taken: Sequence[Step], reason: str) -> None:
        """The other shot of a pair does not count without its partner."""
        if not taken:
            return
        pair = taken[0].planned.pair
        assert pair is not None, "only pairs have more than one step"
        self._shooter.write(PairVoided(pair, tuple(s.planned.shot for s in taken), reason))
        self._tally.void(len(taken))

    def _drift_mm(self, outcome: Outcome) -> float:
        if self._first_drift_mm is None:
            self._first_drift_mm = outcome.point_in_tracker_mm
        return moved_mm(self._first_drift_mm, outcome.point_in_tracker_mm)

    def _judge_drift(self, drift_mm: float) -> None:
        text = f"drift pose {drift_mm:.3f} mm from where it was first, limit {self._rules.drift_mm:g} mm"
        self._shooter.write(Event("drift check", text))
        if drift_mm > self._rules.drift_mm:
            raise GateRefused(
                text,
                remedy="the tracker, the robot or its base has moved: fix it, "
                "then begin anew with `pkmcal run --anew`",
            )

    def _compare_drift(self, step: Step) -> None:
        try:
            outcome = self._shooter.measure(step)
        except ShotLost as lost:
            raise GateRefused(
                f"the drift pose could not be measured after the restart: {lost}",
                remedy="look at the reflector and the beam, then run again",
            ) from lost
        drift = self._drift_mm(outcome)
        reason = f"drift check after a restart: {drift:.3f} mm"
        self._shooter.write(Rejected(outcome.shot, outcome.attempt, reason, outcome))
        self._tally.enter(EngineState.IDLE)
        self._judge_drift(drift)

    def _watch_weather(self, weather: Weather | None) -> None:
        """Tell the operator, once for each new text of the alarm's beginning or end."""
        if weather is None:
            return
        self._first_weather = self._first_weather or weather
        limit = self._rules.temperature_change_degC
        alarm = temperature_alarm(self._first_weather, weather, limit)
        if bool(alarm) != bool(self._alarm):
            text = alarm or "the air is back within its limit"
            self._shooter.write(Event("temperature alarm", text))
            self._tally.event(text)
        self._alarm = alarm
