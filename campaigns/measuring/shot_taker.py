"""One attempt at one shot: intent, move, settle, measure, judge."""

from dataclasses import dataclass
from typing import NoReturn

from campaigns.errors import TargetOutOfReach
from campaigns.journal.records import Durations, Event, Intent, Outcome, Rejected
from campaigns.measuring.monitors import GateDecision, InnovationGate
from campaigns.measuring.motion import Arrival, Mover
from campaigns.measuring.reacquisition import Reacquisition
from campaigns.measuring.run_state import EngineState, RunState
from campaigns.measuring.series_log import SeriesLog
from campaigns.planning.steps import Step
from drivers.errors import BeamBroken, LimitViolation, NoReflector, NotAMeasurement
from drivers.ports import Clock, LaserTracker, RobotController
from drivers.values import Measurement

MOVED = "the robot moved while it was measured"
BROKEN = "beam broken"
"""Beginning of the reason of a shot that was lost with the beam; the report counts these."""
IMPOSSIBLE = "no measurement"
"""Beginning of the reason of a shot whose result cannot be."""


class ShotFailed(Exception):
    """An attempt gave no data, and why."""


class BeamReturned(ShotFailed):
    """The beam was broken, and the tracker has its reflector again: no attempt is counted."""


class ReflectorUnseen(ShotFailed):
    """The reflector was never seen at this pose."""


class ShotRefused(ShotFailed):
    """What was measured is too far from what the shots before let one expect."""

    def __init__(self, reason: str, refused: Outcome, *, relocked: bool) -> None:
        super().__init__(reason)
        self.refused = refused
        self.relocked = relocked
        """Whether the tracker is on a reflector where this pose's should be."""


class TargetRefused(ShotFailed):
    """The robot cannot be sent there; the next attempt could not either. Its cause says why."""


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
        reacquisition: Reacquisition,
    ) -> None:
        self._cell = cell
        self._log = log
        self._mover = mover
        self._gate = gate
        self._tally = tally
        self._reacquisition = reacquisition

    def measure(self, step: Step) -> Outcome:
        """Measure a step; its outcome has passed the gate, and nobody has written it yet.

        Raises `ShotFailed` when the attempt gave no data, or whatever ends the run.
        """
        self._tally.begin(step)
        intent = self._log.begin(step)
        taken = self._take(step, intent)
        outcome, refusal = self._judged(intent, taken)
        if refusal:
            text = self._reject(Rejected(intent.shot, intent.attempt, refusal, outcome))
            if taken.moved:
                raise ShotFailed(text)
            relocked = self._reacquisition.at_expected(outcome.joints)
            raise ShotRefused(text, outcome, relocked=relocked)
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
            raise ShotFailed(self._reject(Rejected(intent.shot, intent.attempt, MOVED, outcome)))
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
        arrival = self._arrived(step, intent)
        self._tally.enter(EngineState.MEASURING)
        started_s = self._cell.clock.now_s()
        try:
            measurement = self._cell.tracker.measure()
        except NotAMeasurement as error:
            reason = f"{IMPOSSIBLE}: {error.problem}"
            raise ShotFailed(self._reject(Rejected(intent.shot, intent.attempt, reason))) from error
        except BeamBroken as error:
            self._lose_beam(intent, arrival, error)
        measure_s = self._cell.clock.now_s() - started_s
        self._tally.see_beam(locked=True)
        return _Taken(arrival, measurement, measure_s, self._mover.has_moved(arrival.state))

    def _arrived(self, step: Step, intent: Intent) -> Arrival:
        try:
            return self._mover.go(step, self._tally.enter)
        except (LimitViolation, TargetOutOfReach) as error:
            self._log.write(Rejected(intent.shot, intent.attempt, error.problem))
            self._tally.rest()
            raise TargetRefused(f"shot {intent.shot}: {error.problem}") from error

    def _lose_beam(self, intent: Intent, arrival: Arrival, error: BeamBroken) -> NoReturn:
        """Wait until the beam is back, or until another pose must tell where the reflector is."""
        self._tally.see_beam(locked=False)
        rejected = Rejected(intent.shot, intent.attempt, f"{BROKEN}: {error.problem}")
        self._log.write(rejected)
        self._tally.enter(EngineState.SUSPENDED)
        text = self._suspended(rejected)
        seen_here = not isinstance(error, NoReflector)
        found = self._reacquisition.wait(arrival.state.joints, seen_here=seen_here)
        self._tally.rest()
        if found:
            raise BeamReturned(text)
        raise ReflectorUnseen(f"shot {intent.shot}: its reflector was not seen from the tracker")

    def _judged(self, intent: Intent, taken: _Taken) -> tuple[Outcome, str]:
        """The outcome with its prediction, and why it cannot count if it cannot."""
        judgement = self._gate.judge(
            taken.arrival.state.joints, taken.measurement.point_in_tracker_mm
        )
        refusal = MOVED if taken.moved else judgement.refusal
        return _outcome(intent, taken, judgement), refusal

    def _reject(self, rejected: Rejected) -> str:
        """Write a rejection, and tell it; returns its text."""
        self._log.write(rejected)
        self._tally.enter(EngineState.SUSPENDED)
        text = self._suspended(rejected)
        self._tally.rest()
        return text

    def _suspended(self, rejected: Rejected) -> str:
        text = f"shot {rejected.shot}, attempt {rejected.attempt}: {rejected.reason}"
        self._announce(Event("suspended", text))
        return text

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
