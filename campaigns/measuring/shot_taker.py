"""One attempt at one shot: intent, move, settle, measure, judge."""

from contextlib import suppress
from dataclasses import dataclass
from typing import NoReturn

from campaigns.journal.records import Durations, Event, Intent, Outcome, Rejected
from campaigns.measuring.monitors import GateDecision, InnovationGate
from campaigns.measuring.motion import Arrival, Mover
from campaigns.measuring.run_state import EngineState, RunState
from campaigns.measuring.series_log import SeriesLog
from campaigns.planning.steps import Step
from drivers.errors import BeamBroken
from drivers.ports import Clock, LaserTracker, RobotController
from drivers.values import Measurement

REACQUIRE_PATIENCE_S = 30.0
LOOK_AGAIN_S = 1.0
MOVED = "the robot moved while it was measured"


class ShotFailed(Exception):
    """An attempt gave no data, and why. The tracker has been asked to find its reflector again."""

    def __init__(self, reason: str, refused: Outcome | None = None) -> None:
        super().__init__(reason)
        self.refused = refused
        """What was measured, when it is too far from what the shots before let one expect."""


@dataclass(frozen=True, slots=True)
class Cell:
    """The devices of one cell, and its time."""

    robot: RobotController
    tracker: LaserTracker
    clock: Clock
    """Time as the cell lives it: settling and deadlines of motions."""
    wall_clock: Clock
    """Time as the operator lives it: what is left."""


@dataclass(frozen=True, slots=True)
class _Taken:
    """What the devices said at one settled pose, and what that took."""

    arrival: Arrival
    measurement: Measurement
    measure_s: float
    moved: bool
    """Whether the robot moved while it was measured."""


class ShotTaker:
    """Measures shots of one series, each attempt with its intent before and its end after it."""

    def __init__(
        self,
        cell: Cell,
        log: SeriesLog,
        mover: Mover,
        gate: InnovationGate,
        tally: RunState,
        search_mm: float,
    ) -> None:
        self._cell = cell
        self._log = log
        self._mover = mover
        self._gate = gate
        self._tally = tally
        self._search_mm = search_mm

    def measure(self, step: Step) -> Outcome:
        """Measure a step; its outcome has passed the gate, and nobody has written it yet.

        Raises `ShotFailed` when the attempt gave no data, or whatever ends the run.
        """
        self._tally.begin(step)
        intent = self._log.begin(step)
        taken = self._take(step, intent)
        outcome, refusal = self._judged(intent, taken)
        if refusal:
            lost = Rejected(intent.shot, intent.attempt, refusal, outcome)
            self._lose(lost, taken.arrival, None if taken.moved else outcome)
        return outcome

    def look(self, step: Step) -> Outcome:
        """Measure a step whatever the gate would say of it; nobody has written its outcome yet.

        Raises like `measure`.
        """
        self._tally.begin(step)
        intent = self._log.begin(step)
        taken = self._take(step, intent)
        outcome = _outcome(intent, taken, GateDecision(None, None, ""))
        if taken.moved:
            self._lose(Rejected(intent.shot, intent.attempt, MOVED, outcome), taken.arrival)
        return outcome

    def put_aside(self, outcome: Outcome, reason: str) -> None:
        """Write an outcome that was only compared: it does not count."""
        self._log.write(Rejected(outcome.shot, outcome.attempt, reason, outcome))
        self._tally.enter(EngineState.IDLE)

    def accept(self, outcome: Outcome) -> None:
        """Write an outcome: the shot counts, and teaches what to expect of the next one."""
        self._log.write(outcome)
        self._gate.accept(outcome)
        self._tally.enter(EngineState.IDLE)

    def _take(self, step: Step, intent: Intent) -> _Taken:
        arrival = self._mover.go(step, self._tally.enter)
        self._tally.enter(EngineState.MEASURING)
        started_s = self._cell.clock.now_s()
        try:
            measurement = self._cell.tracker.measure()
        except BeamBroken as error:
            self._tally.see_beam(locked=False)
            reason = f"beam broken: {error.problem}"
            self._lose(Rejected(intent.shot, intent.attempt, reason), arrival)
        measure_s = self._cell.clock.now_s() - started_s
        self._tally.see_beam(locked=True)
        return _Taken(arrival, measurement, measure_s, self._mover.has_moved(arrival.state))

    def _judged(self, intent: Intent, taken: _Taken) -> tuple[Outcome, str]:
        """The outcome with its prediction, and why it cannot count if it cannot."""
        judgement = self._gate.judge(
            taken.arrival.state.joints, taken.measurement.point_in_tracker_mm
        )
        refusal = MOVED if taken.moved else judgement.refusal
        return _outcome(intent, taken, judgement), refusal

    def _lose(
        self, rejected: Rejected, arrival: Arrival, refused: Outcome | None = None
    ) -> NoReturn:
        """Write the rejection, have the tracker find its reflector, and raise `ShotFailed`."""
        self._log.write(rejected)
        self._tally.enter(EngineState.SUSPENDED)
        text = f"shot {rejected.shot}, attempt {rejected.attempt}: {rejected.reason}"
        self._announce(Event("suspended", text))
        self._reacquire(arrival)
        self._tally.enter(EngineState.IDLE)
        raise ShotFailed(text, refused)

    def _reacquire(self, arrival: Arrival) -> None:
        """Have the tracker look for its reflector, again and again, while the robot stands still.

        Whoever stands in the beam may take some seconds to leave. A failure in the end is the
        next attempt's.
        """
        given_up_s = self._cell.clock.now_s() + REACQUIRE_PATIENCE_S
        while (failure := self._failure_to_find(arrival)) is not None:
            self._tally.see_beam(locked=False)
            self._mover.check_stop()
            if self._cell.clock.now_s() >= given_up_s:
                self._announce(Event("beam broken", f"no reflector found again: {failure}"))
                return
            self._cell.clock.sleep_s(LOOK_AGAIN_S)
        self._tally.see_beam(locked=True)
        self._announce(Event("resumed", "the tracker has its reflector again"))

    def _failure_to_find(self, arrival: Arrival) -> str | None:
        try:
            self._look_for_reflector(arrival.state.joints)
        except BeamBroken as error:
            return error.problem
        return None

    def _look_for_reflector(self, joints: tuple[float, ...]) -> None:
        """Point to where it should be; while that is unknown, near where it was, and search there.

        Raises `BeamBroken` when it is not found.
        """
        expected_mm = self._gate.expected_point_mm(joints)
        if expected_mm is not None:
            self._cell.tracker.go_to(expected_mm)
            return
        nearest_mm = self._gate.nearest_point_mm(joints)
        if nearest_mm is not None:
            with suppress(BeamBroken):
                self._cell.tracker.go_to(nearest_mm)
                return
        self._cell.tracker.find_reflector(self._search_mm)

    def _announce(self, event: Event) -> None:
        self._log.write(event)
        self._tally.event(event.text)


def _outcome(intent: Intent, taken: _Taken, judgement: GateDecision) -> Outcome:
    arrival, measurement = taken.arrival, taken.measurement
    return Outcome(
        intent.shot,
        intent.attempt,
        arrival.state.joints,
        measurement.point_in_tracker_mm,
        measurement.covariance_mm2,
        measurement.weather,
        arrival.state.raw,
        measurement.raw,
        Durations(arrival.move_s, arrival.settle_s, taken.measure_s),
        judgement.predicted_in_tracker_mm,
        judgement.residual_mm,
        arrival.came_from,
    )
