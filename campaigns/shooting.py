"""One attempt at one shot: intent, move, settle, measure, judge, outcome."""

from dataclasses import dataclass, replace
from typing import NoReturn

from campaigns.guards import Gate
from campaigns.journal import Journal
from campaigns.motion import Arrival, Mover
from campaigns.progress import EngineState
from campaigns.records import Durations, Event, Intent, Outcome, Record, Rejected
from campaigns.steps import Step
from campaigns.tally import Tally
from drivers.errors import BeamBroken
from drivers.ports import Clock, LaserTracker, RobotController
from drivers.values import Measurement

FIND_DISTANCE_MM = 2500.0
"""Where to search for the reflector while nothing is known about the tracker's frame."""


class ShotLost(Exception):  # noqa: N818 - an outcome inside the engine, not an error of it
    """An attempt gave no data, and why. The tracker has been asked to find its reflector again."""


@dataclass(frozen=True, slots=True)
class Cell:
    """The devices of one cell, and its time."""

    robot: RobotController
    tracker: LaserTracker
    clock: Clock
    """Time as the cell lives it: settling and deadlines of motions."""
    wall_clock: Clock
    """Time as the operator lives it: what is left."""


class Shooter:
    """Takes shots into one series of the journal."""

    def __init__(
        self, cell: Cell, journal: Journal, series: int, mover: Mover, gate: Gate, tally: Tally
    ) -> None:
        self._cell = cell
        self._journal = journal
        self._series = series
        self._mover = mover
        self._gate = gate
        self._tally = tally

    def take(self, step: Step) -> Outcome:
        """Measure a step and write its outcome; raises `ShotLost` when the attempt gave no data."""
        outcome = self.measure(step)
        self.write(outcome)
        self._gate.accept(outcome.joints_rad, outcome.point_in_tracker_mm)
        self._tally.enter(EngineState.IDLE)
        return outcome

    def measure(self, step: Step) -> Outcome:
        """Measure a step; its outcome has passed the gate, but is not written yet."""
        self._tally.begin(step)
        attempt = self._journal.next_attempt(self._series, step.planned.shot)
        self.write(_intent(step, attempt))
        arrival = self._mover.go(step, self._tally.enter)
        self._tally.enter(EngineState.MEASURING)
        started_s = self._cell.clock.now_s()
        try:
            measurement = self._cell.tracker.measure()
        except BeamBroken as error:
            self._lose(
                Rejected(step.planned.shot, attempt, f"beam broken: {error.problem}"), arrival
            )
        moved = self._mover.has_moved(arrival.state)
        measure_s = self._cell.clock.now_s() - started_s
        durations = Durations(arrival.move_s, arrival.settle_s, measure_s)
        outcome, refusal = self._judged(_outcome(step, attempt, arrival, measurement, durations))
        if moved:
            refusal = "the robot moved while it was measured"
        if refusal:
            self._lose(Rejected(step.planned.shot, attempt, refusal, outcome), arrival)
        return outcome

    def write(self, record: Record) -> None:
        """Put a record into this series."""
        self._journal.append(record, series=self._series)

    def _judged(self, outcome: Outcome) -> tuple[Outcome, str]:
        """The outcome with its prediction, and why it cannot count if it cannot."""
        judgement = self._gate.judge(outcome.joints_rad, outcome.point_in_tracker_mm)
        predicted, residual = judgement.predicted_in_tracker_mm, judgement.residual_mm
        told = replace(outcome, predicted_in_tracker_mm=predicted, residual_mm=residual)
        return told, judgement.refusal

    def _lose(self, rejected: Rejected, arrival: Arrival) -> NoReturn:
        """Write the rejection, have the tracker find its reflector again, and raise `ShotLost`."""
        self.write(rejected)
        self._tally.enter(EngineState.SUSPENDED)
        text = f"shot {rejected.shot}, attempt {rejected.attempt}: {rejected.reason}"
        self._announce(Event("suspended", text))
        self._reacquire(arrival)
        self._tally.enter(EngineState.IDLE)
        raise ShotLost(rejected.reason)

    def _reacquire(self, arrival: Arrival) -> None:
        """Point the tracker where the reflector should be; a failure here is the next attempt's."""
        expected = self._gate.expected_point_mm(arrival.state.joints_rad)
        try:
            if expected is None:
                self._cell.tracker.find_reflector(FIND_DISTANCE_MM)
            else:
                self._cell.tracker.go_to(expected)
        except BeamBroken as error:
            self._announce(Event("beam broken", f"no reflector found again: {error.problem}"))
        else:
            self._announce(Event("resumed", "the tracker has its reflector again"))

    def _announce(self, event: Event) -> None:
        self.write(event)
        self._tally.event(event.text)


def _intent(step: Step, attempt: int) -> Intent:
    planned = step.planned
    return Intent(
        planned.shot,
        attempt,
        planned.purpose.value,
        planned.pose,
        planned.joints_rad,
        step.command,
        planned.pair,
    )


def _outcome(
    step: Step, attempt: int, arrival: Arrival, measurement: Measurement, durations: Durations
) -> Outcome:
    return Outcome(
        step.planned.shot,
        attempt,
        arrival.state.joints_rad,
        measurement.point_in_tracker_mm,
        measurement.covariance_mm2,
        measurement.weather,
        arrival.state.raw,
        measurement.raw,
        durations,
    )
