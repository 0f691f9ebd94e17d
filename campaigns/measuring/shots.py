"""One shot: intent, move, settle, measure, judge; and again until there is data.

Each attempt has its intent in the journal before anything moves and its end after it. It gives one
of four results: `Accepted`, with an outcome that is still to be written; `Skipped` by the operator;
`Refused`, where a point was measured that contradicts the accepted ones; `Lost`, without data.
"""

from collections.abc import Callable
from dataclasses import replace

from campaigns.errors import GateRefused, TargetOutOfReach
from campaigns.journal.records import Durations, Event, Intent, Outcome, Rejected
from campaigns.measuring.beam import Beam
from campaigns.measuring.motion import Arrival
from campaigns.measuring.nests import NestPointer
from campaigns.measuring.results import SKIPPED, Accepted, Loss, Lost, Refused, ShotResult, Skipped
from campaigns.measuring.run_state import EngineState, Wish
from campaigns.measuring.work import Session
from campaigns.planning.steps import Step
from drivers.errors import BeamBroken, LimitViolation, NoReflector, NotAMeasurement

FORGIVEN_BREAKS = 10
"""Breaks of the beam, one after another at one shot, that count no attempt.

A reflector that is found each time and lost each time while it is measured is no passer-by.
"""


class Shots:
    """Measures shots of one series."""

    def __init__(self, session: Session, beam: Beam, nests: NestPointer) -> None:
        self._session = session
        self._log, self._run_state = session.log, session.run_state
        self._beam = beam
        self.nests = nests
        self._begun: int | None = None
        """Shot that was begun, and that neither counts nor was compared yet."""

    def retry(self, attempt: Callable[[], ShotResult], allowed: int | None = None) -> ShotResult:
        """Try until there is data, it is skipped, or another attempt could not change anything."""
        attempts = allowed or self._session.work.gate.attempts
        failures = breaks = 0
        while True:
            result = attempt()
            match result:
                case Accepted() | Skipped():
                    return result
                case Lost(loss=Loss.BEAM):
                    breaks += 1
                    failures += breaks > FORGIVEN_BREAKS
                case Lost(loss=Loss.UNSEEN):
                    failures += self._beam.wait_where_it_was()
                case _:
                    failures += 1
            if failures >= attempts or _is_hopeless(result):
                return replace(result, attempts=failures)

    def take(self, step: Step, *, is_judged: bool = True) -> ShotResult:
        """Measure a step once; the gate judges it if `is_judged`, unless it is a nest's."""
        nest = step.planned.nest
        if not nest:
            self.nests.leave()
        if self._is_skipped_already(step.planned.shot):
            return Skipped()
        self._run_state.begin(step)
        intent = self._log.begin(step)
        arrival = self._go(step, intent)
        if not isinstance(arrival, Arrival):
            return arrival
        outcome = self._measure(intent, arrival, nest)
        if not isinstance(outcome, Outcome):
            return outcome
        if not nest:
            self._beam.remember(outcome)
        return self._judge(outcome, arrival, is_judged=is_judged and not nest)

    def compare_only(self, outcome: Outcome, reason: str) -> None:
        """Write an outcome that was only compared: it does not count."""
        self._log.write(Rejected(outcome.shot, outcome.attempt, reason, outcome))
        self._end(f"shot {outcome.shot} was compared already")

    def accept(self, outcome: Outcome) -> None:
        """Write an outcome: the shot counts, and helps to predict the next one."""
        self._log.write(outcome)
        self._session.gate.accept(outcome)
        self._end_accepted(outcome)

    def accept_nest(self, nest: str, outcome: Outcome) -> None:
        """Write a nest's outcome, which counts; raise `GateRefused` for another reflector."""
        limit_mm = self._session.work.gate.drift_mm
        try:
            moved_mm = self.nests.moved_mm(nest, outcome)
        except GateRefused as error:
            self._log.write(Rejected(outcome.shot, outcome.attempt, error.problem, outcome))
            raise
        self._log.write(outcome)
        self._end_accepted(outcome)
        text = f"nest {nest} is {moved_mm:.3f} mm from where it was first, limit {limit_mm:g} mm"
        event = Event("drift check", f"shot {outcome.shot}: {text}")
        (self._log.announce if moved_mm > limit_mm else self._log.write)(event)

    def _go(self, step: Step, intent: Intent) -> Arrival | Skipped | Lost:
        """Move to a step's pose, and settle there."""
        try:
            arrival = self._session.mover.go(step, self._run_state.enter)
        except (LimitViolation, TargetOutOfReach) as error:
            self._log.write(Rejected(intent.shot, intent.attempt, error.problem))
            self._run_state.rest()
            return Lost(f"shot {intent.shot}: {error.problem}", Loss.TARGET, error)
        if self._session.wishes.take(Wish.SKIP):
            self._log.write(Rejected(intent.shot, intent.attempt, SKIPPED))
            self._run_state.rest()
            return Skipped()
        return arrival

    def _measure(self, intent: Intent, arrival: Arrival, nest: str) -> Outcome | Skipped | Lost:
        """Measure the robot's reflector, or a nest's, and compare with the raw answers."""
        cell = self._session.cell
        self._run_state.enter(EngineState.MEASURING)
        try:
            if nest:
                self.nests.point_at(nest)
            started_s = cell.clock.now_s()
            measurement = cell.tracker.measure()
        except NotAMeasurement as error:
            return self._lose(intent, f"no measurement: {error.problem}")
        except BeamBroken as error:
            if nest:
                return self._lose(intent, f"beam broken at nest {nest}: {error.problem}")
            return self._wait_for_beam(intent, arrival, error)
        self._run_state.see_beam(locked=True)
        outcome = Outcome(
            intent.shot,
            intent.attempt,
            arrival.state.joints,
            measurement.point_in_tracker_mm,
            measurement.covariance_mm2,
            measurement.weather,
            arrival.state.raw,
            measurement.raw,
            Durations(arrival.move_s, arrival.settle_s, cell.clock.now_s() - started_s),
            came_from=arrival.came_from,
        )
        if cell.raw_readers is not None:
            cell.raw_readers.check(outcome)
        return outcome

    def _judge(self, outcome: Outcome, arrival: Arrival, *, is_judged: bool) -> ShotResult:
        """Refuse a point that contradicts the others, and one of a robot that has moved."""
        refusal = ""
        if is_judged:
            decision = self._session.gate.judge(outcome)
            refusal = decision.refusal
            outcome = replace(
                outcome,
                predicted_in_tracker_mm=decision.predicted_in_tracker_mm,
                residual_mm=decision.residual_mm,
            )
        if self._session.mover.has_moved(arrival.state):
            return self._lose(outcome, "the robot moved while it was measured")
        if refusal:
            reason = self._reject(outcome, refusal)
            self._run_state.rest()
            expected_mm = self._session.gate.expected_point_mm(outcome.joints)
            return Refused(reason, outcome, relocked=self._beam.is_at(expected_mm))
        return Accepted(outcome)

    def _wait_for_beam(self, intent: Intent, arrival: Arrival, error: BeamBroken) -> Skipped | Lost:
        """Wait until the beam is back, or until another pose must show where the reflector is."""
        self._run_state.see_beam(locked=False)
        reason = self._reject(intent, f"beam broken: {error.problem}")
        seen_here = not isinstance(error, NoReflector)
        waited = self._beam.wait(arrival.state.joints, seen_here=seen_here)
        self._run_state.rest()
        match waited:
            case Skipped():
                return waited
            case Loss.UNSEEN:
                reason = f"shot {intent.shot}: its reflector was not seen from the tracker"
        return Lost(reason, waited)

    def _is_skipped_already(self, shot: int) -> bool:
        """Begin a shot; return whether the operator asked to skip it between its attempts."""
        was_begun, self._begun = self._begun == shot, shot
        if not self._session.wishes.take(Wish.SKIP):
            return False
        if not was_begun:
            self._note_too_late("no shot was being taken")
        return was_begun

    def _end_accepted(self, outcome: Outcome) -> None:
        self._end(f"shot {outcome.shot} is already measured; press r to redo it")

    def _end(self, too_late: str) -> None:
        """End a shot that is done; a wish to skip it came too late for that."""
        self._begun = None
        self._run_state.enter(EngineState.IDLE)
        if self._session.wishes.take(Wish.SKIP):
            self._note_too_late(too_late)

    def _note_too_late(self, why: str) -> None:
        self._log.announce(Event("operator note", f"nothing is skipped: {why}"))

    def _lose(self, attempt: Intent | Outcome, why: str) -> Lost:
        """Write that an attempt gave no data, and return it."""
        reason = self._reject(attempt, why)
        self._run_state.rest()
        return Lost(reason, Loss.MEASUREMENT)

    def _reject(self, attempt: Intent | Outcome, why: str) -> str:
        """Write a rejection, and name it to the operator; return its text."""
        measured = attempt if isinstance(attempt, Outcome) else None
        self._log.write(Rejected(attempt.shot, attempt.attempt, why, measured))
        self._run_state.enter(EngineState.SUSPENDED)
        text = f"shot {attempt.shot}, attempt {attempt.attempt}: {why}"
        self._log.announce(Event("suspended", text))
        return text


def _is_hopeless(result: Refused | Lost) -> bool:
    """Return whether another attempt would end alike.

    The target is refused again, or the tracker is still on what was refused.
    """
    match result:
        case Refused(relocked=relocked):
            return not relocked
        case Lost(loss=loss):
            return loss is Loss.TARGET
