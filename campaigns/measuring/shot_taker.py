"""One attempt at one shot: intent, move, settle, measure, judge; and again until there is data."""

from collections.abc import Callable
from dataclasses import replace
from typing import NoReturn, TypeVar

from campaigns.errors import GateRefused, TargetOutOfReach
from campaigns.journal.records import Durations, Event, Intent, Outcome, Rejected
from campaigns.measuring.motion import Arrival
from campaigns.measuring.nests import NestPointer
from campaigns.measuring.reacquisition import Reacquisition
from campaigns.measuring.run_state import EngineState
from campaigns.measuring.wishes import Wish
from campaigns.measuring.work import Session
from campaigns.planning.steps import Step
from drivers.errors import BeamBroken, LimitViolation, NoReflector, NotAMeasurement

MOVED = "the robot moved while it was measured"
BROKEN = "beam broken"
"""Beginning of the reason of a shot that was lost with the beam; the report counts these."""
IMPOSSIBLE = "no measurement"
"""Beginning of the reason of a shot whose result cannot be."""
SKIPPED = "skipped by the operator"
NOT_SKIPPED = "nothing is skipped: "
FORGIVEN_BREAKS = 10
"""Breaks of the beam, one after another at one shot, that count no attempt.

A reflector that is found each time and lost each time while it is measured is no passer-by.
"""
Result = TypeVar("Result")


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


class Skipped(ShotFailed):
    """The operator leaves the shot out."""


class TargetRefused(ShotFailed):
    """The robot cannot be sent there; the next attempt could not either. Its cause says why."""


class ShotTaker:
    """Measures shots of one series, each attempt with its intent before and its end after it."""

    def __init__(self, session: Session, reacquisition: Reacquisition, nests: NestPointer) -> None:
        self._session = session
        self._reacquisition = reacquisition
        self.nests = nests
        self._tried: int | None = None
        """Shot that was begun, and that neither counts nor was compared yet."""

    def retry(self, attempt: Callable[[], Result], allowed: int | None = None) -> Result:
        """Try until there is data; raises `GateRefused`, whose cause is the last `ShotFailed`.

        At once where another attempt could not change anything.
        """
        failures: list[ShotFailed] = []
        breaks = 0
        while len(failures) < (allowed or self._session.work.gate.attempts):
            try:
                return attempt()
            except Skipped:
                raise
            except BeamReturned as lost:
                breaks += 1
                failures += [lost] if breaks > FORGIVEN_BREAKS else []
            except ReflectorUnseen as lost:
                failures += [lost] if self._reacquisition.wait_where_it_was() else []
            except ShotFailed as lost:
                failures.append(lost)
                if isinstance(lost, TargetRefused) or _is_hopeless(lost):
                    break
        raise _refused(failures) from failures[-1]

    def measure(self, step: Step) -> Outcome:
        """Measure a step; its outcome has passed the gate, and nobody has written it yet.

        Raises `ShotFailed` when the attempt gave no data, or whatever ends the run.
        """
        outcome, moved = self._taken(step)
        if step.planned.nest:
            self._require_still(outcome, moved=moved)
            return outcome
        judged = self._session.gate.judge(outcome.joints, outcome.point_in_tracker_mm)
        outcome = replace(
            outcome,
            predicted_in_tracker_mm=judged.predicted_in_tracker_mm,
            residual_mm=judged.residual_mm,
        )
        self._require_still(outcome, moved=moved)
        if judged.refusal:
            text = self._reject(outcome, judged.refusal, outcome)
            relocked = self._reacquisition.at_expected(outcome.joints)
            raise ShotRefused(text, outcome, relocked=relocked)
        return outcome

    def look(self, step: Step) -> Outcome:
        """Measure a step whatever the gate would say of it; nobody has written its outcome yet.

        Raises like `measure`.
        """
        outcome, moved = self._taken(step)
        self._require_still(outcome, moved=moved)
        return outcome

    def compare_only(self, outcome: Outcome, reason: str) -> None:
        """Write an outcome that was only compared: it does not count."""
        self._session.log.write(Rejected(outcome.shot, outcome.attempt, reason, outcome))
        self._end(outcome, "compared")

    def accept(self, outcome: Outcome) -> None:
        """Write an outcome: the shot counts, and teaches what to expect of the next one."""
        self._session.log.write(outcome)
        self._session.gate.accept(outcome)
        self._end(outcome)

    def accept_nest(self, nest: str, outcome: Outcome) -> None:
        """Write a nest's outcome, which counts; raises `GateRefused` for another reflector."""
        log, limit_mm = self._session.log, self._session.work.gate.drift_mm
        try:
            moved_mm = self.nests.moved_mm(nest, outcome)
        except GateRefused as error:
            log.write(Rejected(outcome.shot, outcome.attempt, error.problem, outcome))
            raise
        log.write(outcome)
        self._end(outcome)
        text = f"nest {nest} is {moved_mm:.3f} mm from where it was first, limit {limit_mm:g} mm"
        event = Event("drift check", f"shot {outcome.shot}: {text}")
        (log.announce if moved_mm > limit_mm else log.write)(event)

    def _taken(self, step: Step) -> tuple[Outcome, bool]:
        """What the devices said at the settled pose, and whether the robot moved meanwhile."""
        session, clock = self._session, self._session.cell.clock
        if not step.planned.nest:
            self.nests.leave()
        self._begin(step.planned.shot)
        session.run_state.begin(step)
        intent = session.log.begin(step)
        arrival = self._arrived(step, intent)
        if session.wishes.take(Wish.SKIP):
            session.log.write(Rejected(intent.shot, intent.attempt, SKIPPED))
            session.run_state.rest()
            raise Skipped(SKIPPED)
        session.run_state.enter(EngineState.MEASURING)
        nest = step.planned.nest
        try:
            if nest:
                self.nests.point_at(nest)
            started_s = clock.now_s()
            measurement = session.cell.tracker.measure()
        except NotAMeasurement as error:
            raise ShotFailed(self._reject(intent, f"{IMPOSSIBLE}: {error.problem}")) from error
        except BeamBroken as error:
            if nest:
                text = self._reject(intent, f"{BROKEN} at nest {nest}: {error.problem}")
                raise ShotFailed(text) from error
            self._lose_beam(intent, arrival, error)
        measure_s = clock.now_s() - started_s
        session.run_state.see_beam(locked=True)
        outcome = Outcome(
            intent.shot,
            intent.attempt,
            arrival.state.joints,
            measurement.point_in_tracker_mm,
            measurement.covariance_mm2,
            measurement.weather,
            arrival.state.raw,
            measurement.raw,
            Durations(arrival.move_s, arrival.settle_s, measure_s),
            came_from=arrival.came_from,
        )
        if session.cell.raw_readers is not None:
            session.cell.raw_readers.check(outcome)
        if not nest:
            self._reacquisition.remember(outcome)
        return outcome, session.mover.has_moved(arrival.state)

    def _begin(self, shot: int) -> None:
        """A shot is tried; raises `Skipped` where the wish came between its attempts."""
        was_tried, self._tried = self._tried == shot, shot
        if self._session.wishes.take(Wish.SKIP):
            if was_tried:
                raise Skipped(SKIPPED)
            text = f"{NOT_SKIPPED}no shot was being taken"
            self._session.log.announce(Event("operator note", text))

    def _end(self, outcome: Outcome, how: str = "measured") -> None:
        """A shot is done; a wish to skip it came too late for that."""
        self._tried = None
        self._session.run_state.enter(EngineState.IDLE)
        if self._session.wishes.take(Wish.SKIP):
            counts = "; r voids it, and measures it again" if how == "measured" else ""
            text = f"{NOT_SKIPPED}shot {outcome.shot} was {how} already{counts}"
            self._session.log.announce(Event("operator note", text))

    def _arrived(self, step: Step, intent: Intent) -> Arrival:
        session = self._session
        try:
            return session.mover.go(step, session.run_state.enter)
        except (LimitViolation, TargetOutOfReach) as error:
            session.log.write(Rejected(intent.shot, intent.attempt, error.problem))
            session.run_state.rest()
            raise TargetRefused(f"shot {intent.shot}: {error.problem}") from error

    def _lose_beam(self, intent: Intent, arrival: Arrival, error: BeamBroken) -> NoReturn:
        """Wait until the beam is back, or until another pose must tell where the reflector is."""
        self._session.run_state.see_beam(locked=False)
        text = self._suspend(intent, f"{BROKEN}: {error.problem}")
        seen_here = not isinstance(error, NoReflector)
        found = self._reacquisition.wait(arrival.state.joints, seen_here=seen_here)
        self._session.run_state.rest()
        if found is None:
            raise Skipped(SKIPPED)
        if found:
            raise BeamReturned(text)
        raise ReflectorUnseen(f"shot {intent.shot}: its reflector was not seen from the tracker")

    def _require_still(self, outcome: Outcome, *, moved: bool) -> None:
        if moved:
            raise ShotFailed(self._reject(outcome, MOVED, outcome))

    def _reject(
        self, attempt: Intent | Outcome, reason: str, measured: Outcome | None = None
    ) -> str:
        """Write a rejection, and tell it; returns its text."""
        text = self._suspend(attempt, reason, measured)
        self._session.run_state.rest()
        return text

    def _suspend(
        self, attempt: Intent | Outcome, reason: str, measured: Outcome | None = None
    ) -> str:
        session, shot, number = self._session, attempt.shot, attempt.attempt
        session.log.write(Rejected(shot, number, reason, measured))
        session.run_state.enter(EngineState.SUSPENDED)
        text = f"shot {shot}, attempt {number}: {reason}"
        session.log.announce(Event("suspended", text))
        return text


def _is_hopeless(lost: ShotFailed) -> bool:
    """Whether the tracker is still on what was refused: it would be refused again."""
    return isinstance(lost, ShotRefused) and not lost.relocked


def _refused(failures: list[ShotFailed]) -> GateRefused:
    attempts = f"{len(failures)} attempts" if len(failures) > 1 else "the attempt"
    return GateRefused(
        f"{attempts} failed, the last one: {failures[-1]}",
        remedy="look at the reflector, the beam and the robot there; then run again, it resumes. "
        "If an earlier shot took the wrong reflector: start a new series with --anew",
    )
