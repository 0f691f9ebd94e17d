"""One shot: intent, move, settle, measure, judge; and again until there is data.

An attempt takes these steps, and their order is what makes its data trustworthy:

1. The intent is on the disk before anything moves: if the process dies, its number is not used
   again.
2. The robot moves and settles. Its joints are read when it has stood still in place.
3. The tracker measures. Its raw answer and the robot's are decoded a second time and compared.
4. The gate compares the point with the one predicted by the accepted shots.
5. The robot is read again: if it has moved since step 2, joints and point are not of one pose.
6. The end is written: a rejection here, the outcome by `accept`, which the engine calls once the
   shot has passed its own checks, too. Each intent has exactly one end.
"""

from collections.abc import Callable
from dataclasses import replace

from campaigns.errors import GateRefused, TargetOutOfReach
from campaigns.journal.records import Durations, Event, Intent, Outcome, Rejected
from campaigns.measuring.beam import Beam
from campaigns.measuring.motion import Arrival
from campaigns.measuring.nests import NestPointer
from campaigns.measuring.reflector_carrier import ReflectorCarrier
from campaigns.measuring.results import (
    SKIPPED,
    TAKEN_BACK,
    Accepted,
    Loss,
    Lost,
    Refused,
    ShotResult,
    Skipped,
    TakenBack,
)
from campaigns.measuring.run_state import EngineState, Wish
from campaigns.measuring.work import Session
from campaigns.planning.steps import Step
from drivers.errors import BeamBroken, LimitViolation, NoReflector, NotAMeasurement

FORGIVEN_BREAKS = 10
"""Largest number of breaks of the beam at one shot that do not count as attempts.

People walk through a beam, but not that often: a reflector that is found each time and lost again
while it is measured is hidden or loose.
"""


class ShotTaker:
    """Measures single shots of one series, and writes how each attempt ended."""

    def __init__(self, session: Session, beam: Beam, nests: NestPointer) -> None:
        self._session, self._rules = session, session.work.rules
        self._log, self._run_state = session.log, session.run_state
        self._beam = beam
        self._carrier = ReflectorCarrier(session)
        self.nests = nests
        self._begun: int | None = None
        """Shot that was begun last; None once it counts or has been compared."""

    def retry(self, attempt: Callable[[], ShotResult], allowed: int | None = None) -> ShotResult:
        """Repeat an attempt until there is data, it is skipped, or no other attempt can help."""
        # Only failures of this pose count against the attempts. A broken beam does not at first: it
        # was waited for, and is back. A reflector that was never seen here counts only if it is
        # visible at once from the pose before: then the beam is in order, and this pose is hidden.
        attempts = allowed or self._rules.gate.attempts
        failures = breaks = 0
        while True:
            result = attempt()
            match result:
                case Accepted() | Skipped() | TakenBack():
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
        # For the order of the steps see the head of this module.
        nest = step.planned.nest
        if not nest:
            self.nests.leave()  # the beam back onto the robot, before the robot moves away with it
        if self._is_skipped_already(step.planned.shot):
            return Skipped()
        if self._session.wishes.take(Wish.BACK):
            return TakenBack()
        if not nest:
            self._carrier.bring(step.planned.reflector)
        self._run_state.begin(step)
        intent = self._log.begin(step)
        arrival = self._go(step, intent)
        if not isinstance(arrival, Arrival):
            return arrival
        outcome = self._measure(intent, arrival, nest)
        if not isinstance(outcome, Outcome):
            return outcome
        if not nest:
            # Also points that are refused later: one point at several poses shows a robot that does
            # not move.
            self._beam.remember(outcome)
        return self._judge(outcome, arrival, is_judged=is_judged and not nest)

    def compare_only(self, outcome: Outcome, reason: str) -> None:
        """Write an outcome that served a comparison, as rejected: it does not count."""
        self._log.write(Rejected(outcome.shot, outcome.attempt, reason, outcome))
        self._end(f"shot {outcome.shot} was compared already")

    def accept(self, outcome: Outcome) -> None:
        """Write an outcome: the shot counts, and helps to predict the next one."""
        # In this order no shot is judged by one that a crash could lose.
        self._log.write(outcome)
        self._session.gate.accept(outcome)
        self._end_accepted(outcome)

    def accept_nest(self, nest: str, outcome: Outcome) -> None:
        """Write a nest's outcome, which counts; raise `GateRefused` for another reflector."""
        limit_mm = self._rules.gate.drift_mm
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

    def _go(self, step: Step, intent: Intent) -> Arrival | Skipped | TakenBack | Lost:
        """Move to a step's pose, and settle there."""
        # Only a target that is refused before anything moves is a matter of this one pose. Faults,
        # an emergency stop or a robot that does not settle pass through, and end the run.
        try:
            arrival = self._session.mover.go(step, self._run_state.enter)
        except (LimitViolation, TargetOutOfReach) as error:
            self._log.write(Rejected(intent.shot, intent.attempt, error.problem))
            self._run_state.show_idle()
            return Lost(f"shot {intent.shot}: {error.problem}", Loss.TARGET, error)
        # A wish to skip never stops a motion half-way: the robot arrives, and is not measured.
        if self._session.wishes.take(Wish.SKIP):
            self._log.write(Rejected(intent.shot, intent.attempt, SKIPPED))
            self._run_state.show_idle()
            return Skipped()
        if self._session.wishes.take(Wish.BACK):
            self._log.write(Rejected(intent.shot, intent.attempt, TAKEN_BACK))
            self._run_state.show_idle()
            return TakenBack()
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
            if nest:  # no waiting: the beam goes back to the robot before its next shot
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
            reflector=intent.reflector,
        )
        if cell.raw_readers is not None:
            cell.raw_readers.check(outcome)
        return outcome

    def _judge(self, outcome: Outcome, arrival: Arrival, *, is_judged: bool) -> ShotResult:
        """Refuse a point that contradicts the others; reject one if the robot has moved."""
        # The gate first, for its prediction is kept with the rejection, too. That the robot has
        # moved then outranks a refusal: a wrong pose is no evidence of a wrong reflector.
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
            self._run_state.show_idle()
            # Look at once where this pose's reflector should be. If one is there, the tracker was
            # on another, and the next attempt measures the right one; if not, see the engine.
            expected_mm = self._session.gate.expected_point_mm(outcome.joints)
            return Refused(reason, outcome, relocked=self._beam.is_at(expected_mm))
        return Accepted(outcome)

    def _wait_for_beam(self, intent: Intent, arrival: Arrival, error: BeamBroken) -> Skipped | Lost:
        """Wait until the beam is back, or until another pose must show where the reflector is."""
        # The rejection comes before the wait, which may last for hours.
        self._run_state.see_beam(locked=False)
        reason = self._reject(intent, f"beam broken: {error.problem}")
        seen_here = not isinstance(error, NoReflector)
        waited = self._beam.wait(arrival.state.joints, seen_here=seen_here)
        self._run_state.show_idle()
        match waited:
            case Skipped():
                return waited
            case Loss.UNSEEN:
                reason = f"shot {intent.shot}: its reflector was not seen from the tracker"
        return Lost(reason, waited)

    def _is_skipped_already(self, shot: int) -> bool:
        """Begin a shot; return whether the operator asked to skip it between its attempts."""
        # A wish belongs to the shot that was on the screen when the key was pressed. Pressed while
        # no shot was being taken, it must not leave out the next one.
        was_begun, self._begun = self._begun == shot, shot
        if not self._session.wishes.take(Wish.SKIP):
            return False
        if not was_begun:
            self._note_too_late("no shot was being taken")
        return was_begun

    def _end_accepted(self, outcome: Outcome) -> None:
        self._end(f"shot {outcome.shot} is already measured; press r to redo it")

    def _end(self, too_late: str) -> None:
        """End a shot that is done; a wish to skip it has come too late."""
        self._begun = None
        self._run_state.enter(EngineState.IDLE)
        if self._session.wishes.take(Wish.SKIP):
            self._note_too_late(too_late)

    def _note_too_late(self, why: str) -> None:
        self._log.announce(Event("operator note", f"nothing is skipped: {why}"))

    def _lose(self, attempt: Intent | Outcome, why: str) -> Lost:
        """Write that an attempt gave no data, and return it."""
        reason = self._reject(attempt, why)
        self._run_state.show_idle()
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
    """Return whether another attempt would end in the same way.

    The controller would refuse the target again, or the tracker measure the refused point again.
    """
    match result:
        case Refused(relocked=relocked):
            return not relocked
        case Lost(loss=loss):
            return loss is Loss.TARGET
