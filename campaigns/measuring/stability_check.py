"""Stability check: poses measured again after a restart and at the end; what has moved."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from math import dist

from campaigns.errors import GateRefused
from campaigns.journal.records import Event, Outcome
from campaigns.measuring.reference_poses import FEWEST, ReferencePose, rigid_body_test
from campaigns.measuring.shot_taker import SKIPPED, ShotRefused, ShotTaker, Skipped
from campaigns.measuring.work import Session

ANEW = (
    "shots before and after it have no common frame: mend it, then begin anew with "
    "--anew; or `pkmcal run` goes on all the same with --anyway"
)

AFTER_RESTART = "after the restart"
"""Beginning of the event of a check that a run did before it went on."""


@dataclass(frozen=True, slots=True, eq=False)
class StabilityCheck:
    """Measures reference poses again: shots that the journal keeps, but are none of the plan's."""

    session: Session
    shot_taker: ShotTaker

    def after_restart(self, references: Sequence[ReferencePose]) -> str:
        """What has changed since these were measured, in words; empty when nothing has."""
        if len(references) == 1:
            try:
                return self._of_one(references[0])
            except Skipped:
                return self._not_compared(AFTER_RESTART)
        return self._change(AFTER_RESTART, references)

    def _of_one(self, reference: ReferencePose) -> str:
        """How far one pose has moved since it was measured, in words; empty within the limit."""
        step, then = reference
        outcome = self.shot_taker.retry(partial(self.shot_taker.measure, step))
        moved_mm = dist(then.point_in_tracker_mm, outcome.point_in_tracker_mm)
        limit_mm = self.session.work.gate.drift_mm
        text = drift_text(f"{AFTER_RESTART} the pose is", moved_mm, limit_mm)
        self._write(f"shot {outcome.shot}: {text}")
        if moved_mm > limit_mm:
            self.shot_taker.compare_only(outcome, text)
            return f"shot {outcome.shot}: {text}"
        self._compare_only(outcome, moved_mm)
        return ""

    def at_end(self, references: Sequence[ReferencePose]) -> str:
        """What the operator should know of the poses at the end; empty when nothing has changed."""
        try:
            return self._change("at the end", references)
        except GateRefused as error:
            text = f"at the end a pose could not be compared: {error.problem}"
            self._write(text)
            return text

    def _change(self, when: str, references: Sequence[ReferencePose]) -> str:
        now, then = list[Outcome](), list[Outcome]()
        for each in references:
            with suppress(Skipped):
                now.append(self._measured_again(each))
                then.append(each[1])
        if len(now) < FEWEST:
            return self._not_compared(when)
        work, kept = self.session.work, self.session.gate.accepted
        noise = work.reference_noise(kept)
        compared = rigid_body_test(work.robot.kinematics, kept, then, now, noise)
        text = f"{when} {compared.text}"
        self._write(text)
        return text if compared.change else ""

    def _not_compared(self, when: str) -> str:
        text = f"{when} it is not known whether anything has moved: {SKIPPED}"
        self.session.log.announce(Event("operator note", text))
        return ""

    def _measured_again(self, reference: ReferencePose) -> Outcome:
        """Outcome of a reference pose, even one that the gate refuses each time for its place.

        One beyond the gate of distances is a wrong target: raises `GateRefused`.
        """
        step, then = reference
        first_mm = then.point_in_tracker_mm
        try:
            outcome = self.shot_taker.retry(partial(self.shot_taker.measure, step))
        except GateRefused as error:
            lost = error.__cause__
            if not isinstance(lost, ShotRefused):
                raise
            if (
                dist(first_mm, lost.refused.point_in_tracker_mm)
                > self.session.work.gate.distance_mm
            ):
                raise
            return lost.refused  # the journal has it already
        self._compare_only(outcome, dist(first_mm, outcome.point_in_tracker_mm))
        return outcome

    def _compare_only(self, outcome: Outcome, away_mm: float) -> None:
        reason = f"only compared with the first one, {away_mm:.3f} mm away"
        self.shot_taker.compare_only(outcome, reason)

    def _write(self, text: str) -> None:
        self.session.log.write(Event("drift check", text))


def drift_text(what: str, moved_mm: float, limit_mm: float) -> str:
    """Distance of a pose from where it was first, and its limit."""
    return f"{what} {moved_mm:.3f} mm from where it was first, limit {limit_mm:g} mm"
