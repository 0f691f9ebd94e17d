"""Body check: poses measured again after a restart and at the end, and compared as a body."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import dist

from campaigns.errors import GateRefused
from campaigns.journal.records import Event, Outcome
from campaigns.measuring.attempts import Attempts
from campaigns.measuring.reference_poses import BodyComparison, ReferencePose
from campaigns.measuring.series_log import SeriesLog
from campaigns.measuring.shot_taker import ShotRefused, ShotTaker
from campaigns.planning.steps import Step
from drivers.values import Vector3

BodyTest = Callable[[Sequence[ReferencePose], Sequence[Outcome]], BodyComparison]
"""What outcomes of the reference poses, in their order, say of tracker and robot."""
ANEW = (
    "what had been measured does not go with what would come: mend it, then begin anew with "
    "--anew; or `pkmcal run` goes on all the same with --anyway"
)


@dataclass(frozen=True, slots=True, eq=False)
class BodyCheck:
    """Measures reference poses again: shots that the journal keeps, but are none of the plan's."""

    log: SeriesLog
    shooter: ShotTaker
    attempts: Attempts
    compare: BodyTest
    gate_mm: float
    """Farther from where it was is a wrong target."""
    drift_mm: float
    """Farther is moved, of one pose alone."""

    def after_restart(self, references: Sequence[ReferencePose]) -> str:
        """What has changed since these were measured, in words; empty when nothing has."""
        compared = self._compared(references)
        text = f"after the restart {compared.text}"
        self.log.write(Event("drift check", text))
        return text if compared.change else ""

    def of_one(self, step: Step, first_mm: Vector3) -> str:
        """How far one pose has moved since it was measured, in words; empty within the limit."""
        outcome = self.attempts.insist(partial(self.shooter.measure, step))
        moved_mm = dist(first_mm, outcome.point_in_tracker_mm)
        text = drift_text("after the restart the pose is", moved_mm, self.drift_mm)
        self.log.write(Event("drift check", f"shot {outcome.shot}: {text}"))
        if moved_mm > self.drift_mm:
            self.shooter.put_aside(outcome, text)
            return f"shot {outcome.shot}: {text}"
        self.shooter.put_aside(outcome, f"only compared with the first one, {moved_mm:.3f} mm away")
        return ""

    def at_end(self, references: Sequence[ReferencePose]) -> str:
        """What the operator should know of the poses at the end; empty when nothing has changed."""
        try:
            compared = self._compared(references)
        except GateRefused as error:
            text = f"at the end a pose could not be compared: {error.problem}"
            self.log.write(Event("drift check", text))
            return text
        text = f"at the end {compared.text}"
        self.log.write(Event("drift check", text))
        return text if compared.change else ""

    def _compared(self, references: Sequence[ReferencePose]) -> BodyComparison:
        return self.compare(references, [self._measured_again(each) for each in references])

    def _measured_again(self, reference: ReferencePose) -> Outcome:
        """Outcome of a reference pose, even one that the gate refuses each time for its place.

        One beyond the gate of distances is a wrong target: raises `GateRefused`.
        """
        try:
            outcome = self.attempts.insist(partial(self.shooter.measure, reference.step))
        except GateRefused as error:
            lost = error.__cause__
            if not isinstance(lost, ShotRefused):
                raise
            if _away_mm(reference.then, lost.refused) > self.gate_mm:
                raise
            return lost.refused  # the journal has it already
        away_mm = _away_mm(reference.then, outcome)
        self.shooter.put_aside(outcome, f"only compared with the first one, {away_mm:.3f} mm away")
        return outcome


def drift_text(what: str, moved_mm: float, limit_mm: float) -> str:
    """Distance of a pose from where it was first, and its limit."""
    return f"{what} {moved_mm:.3f} mm from where it was first, limit {limit_mm:g} mm"


def _away_mm(then: Outcome, now: Outcome) -> float:
    return dist(then.point_in_tracker_mm, now.point_in_tracker_mm)
