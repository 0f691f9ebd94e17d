"""Stability check: poses measured again after a restart and at the end; what has moved."""

from collections.abc import Sequence
from functools import partial
from math import dist

from campaigns.errors import GateRefused
from campaigns.journal.records import Event, Outcome
from campaigns.measuring.reference_poses import FEWEST, ReferencePose, rigid_body_test
from campaigns.measuring.results import SKIPPED, Accepted, Lost, Skipped, failure_of
from campaigns.measuring.shots import Shots
from campaigns.measuring.work import Session
from campaigns.planning.steps import Step

ANEW = (
    "shots before and after it have no common frame: mend it, then begin anew with "
    "--anew; or `pkmcal run DIR --anyway` goes on all the same"
)


class StabilityCheck:
    """Measures reference poses again: shots that the journal keeps, but are none of the plan's."""

    def __init__(self, session: Session, shots: Shots) -> None:
        self._session, self._shots = session, shots

    def after_restart(self, references: Sequence[ReferencePose]) -> str:
        """Return what has changed since these were measured, in words; empty for nothing."""
        return self._compare("after the restart", references)

    def at_end(self, references: Sequence[ReferencePose]) -> str:
        """Return what the operator should know of the poses at the end; empty for no change."""
        try:
            return self._compare("at the end", references)
        except GateRefused as error:
            text = f"at the end a pose could not be compared: {error.problem}"
            self._write(text)
            return text

    def _compare(self, when: str, references: Sequence[ReferencePose]) -> str:
        """Measure the poses again; return what has changed, in words."""
        pairs = [(before, self._measure_again(step, before)) for step, before in references]
        then = [before for before, now in pairs if now is not None]
        again = [now for _, now in pairs if now is not None]
        if len(again) < min(FEWEST, len(references)):
            return self._note_not_compared(when)
        if len(again) < FEWEST:
            return self._compare_one(when, then[0], again[0])
        work, accepted = self._session.work, self._session.gate.accepted
        noise = work.reference_noise(accepted)
        size, change = rigid_body_test(work.robot.kinematics, accepted, then, again, noise)
        text = f"{when} {size}: {change or 'neither tracker nor robot has changed'}"
        self._write(text)
        return text if change else ""

    def _compare_one(self, when: str, before: Outcome, now: Outcome) -> str:
        """Compare one pose with its first measurement by the limit of drift."""
        moved_mm = dist(before.point_in_tracker_mm, now.point_in_tracker_mm)
        limit_mm = self._session.work.gate.drift_mm
        text = f"shot {now.shot}: {drift_text(f'{when} the pose is', moved_mm, limit_mm)}"
        self._write(text)
        return text if moved_mm > limit_mm else ""

    def _note_not_compared(self, when: str) -> str:
        text = f"{when} it is not known whether anything has moved: {SKIPPED}"
        self._session.log.announce(Event("operator note", text))
        return ""

    def _measure_again(self, step: Step, before: Outcome) -> Outcome | None:
        """Return the outcome of a reference pose, even if the gate refuses it; None if skipped.

        One beyond the gate of distances is a wrong target: raise `GateRefused`.
        """
        result = self._shots.retry(partial(self._shots.take, step))
        if isinstance(result, Skipped):
            return None
        if isinstance(result, Lost):
            raise failure_of(result)
        away_mm = dist(before.point_in_tracker_mm, result.outcome.point_in_tracker_mm)
        if isinstance(result, Accepted):  # the journal has a refused one already
            reason = f"only compared with the first one, {away_mm:.3f} mm away"
            self._shots.compare_only(result.outcome, reason)
        elif away_mm > self._session.work.gate.distance_mm:
            raise failure_of(result)
        return result.outcome

    def _write(self, text: str) -> None:
        self._session.log.write(Event("drift check", text))


def drift_text(what: str, moved_mm: float, limit_mm: float) -> str:
    """Return the distance of a pose from where it was first, and its limit, in words."""
    return f"{what} {moved_mm:.3f} mm from where it was first, limit {limit_mm:g} mm"
