"""Wrong targets among the first shots: which shot it was, and back onto the robot's reflector."""

from collections import Counter
from collections.abc import Callable
from functools import partial
from math import dist

from campaigns.errors import GateRefused
from campaigns.journal.records import Outcome
from campaigns.measuring.attempts import Attempts
from campaigns.measuring.monitors import InnovationGate
from campaigns.measuring.reacquisition import Reacquisition
from campaigns.measuring.shot_taker import ShotRefused, ShotTaker
from campaigns.measuring.stopping_rule import in_ranges
from campaigns.planning.steps import Group, Step

SUSPECTS = 3
"""First shots that are measured again when a later one contradicts them."""

VoidShot = Callable[[Outcome, str], Group]
"""Voids an accepted shot for a reason, and names it to the operator; gives its group."""


class WrongTargets:
    """Finds out who is wrong when a shot contradicts those before: they, it, or the beam."""

    def __init__(
        self,
        gate: InnovationGate,
        shooter: ShotTaker,
        reacquisition: Reacquisition,
        attempts: Attempts,
        *,
        step_of: Callable[[int], Step | None],
        void: VoidShot,
        allowed: int,
    ) -> None:
        self._gate = gate
        self._shooter = shooter
        self._reacquisition = reacquisition
        self._attempts = attempts
        self._step_of = step_of
        self._void = void
        self._allowed = allowed
        self._looked_at_again: set[int] = set()
        self._looked_back: Counter[int] = Counter()

    def resolve(self, lost: ShotRefused) -> tuple[Group, ...] | None:
        """The groups to measure anew before the refused one is; None: it is the one at fault.

        Raises `GateRefused` when the beam cannot be brought back onto the robot's reflector.
        """
        refused = lost.refused
        if standing := self._gate.standing(refused):
            return self._leave_standing(standing, refused)
        wrong = self._wrong_first_shot(refused)
        if wrong is not None:
            return (wrong,)
        if lost.relocked or self._looked_back[refused.shot] >= self._allowed - 1:
            return None
        self._looked_back[refused.shot] += 1
        return () if self._reacquisition.look_back() else None

    def _leave_standing(self, standing: tuple[Outcome, ...], refused: Outcome) -> tuple[Group, ...]:
        """Void shots of a reflector that stands still, and find the robot's."""
        shots = sorted((*(each.shot for each in standing), refused.shot))
        text = f"shots {in_ranges(shots)} have one point, although the robot moved between them"
        groups = dict.fromkeys(
            self._void(each, f"{text}: a reflector that stands elsewhere")
            for each in standing
            if each.shot in {outcome.shot for outcome in self._gate.accepted}
        )
        if not self._reacquisition.look_back(refused.point_in_tracker_mm):
            raise GateRefused(
                f"{text}: the tracker is on a reflector that stands elsewhere",
                remedy="put the beam onto the robot's reflector by hand, cover the other one, then "
                "run again: it resumes",
            )
        return tuple(groups)

    def _wrong_first_shot(self, refused: Outcome) -> Group | None:
        """The group of a first shot that is wrong, voided, if it is not the refused one that is.

        Whoever may be it is measured again: once each, and the three likeliest only.
        """
        for suspect in self._gate.suspects(refused)[:SUSPECTS]:
            step = self._step_of(suspect.shot)
            if step is None or suspect.shot in self._looked_at_again:
                continue
            self._looked_at_again.add(suspect.shot)
            again = self._attempts.insist(partial(self._shooter.look, step))
            away_mm = dist(suspect.point_in_tracker_mm, again.point_in_tracker_mm)
            self._shooter.put_aside(
                again, f"only compared with the one before, {away_mm:.3f} mm away"
            )
            if self._gate.is_replaced(suspect, again, refused):
                return self._void(
                    suspect,
                    f"a wrong target or a wrong pose: measured again it is {away_mm:.1f} mm away, "
                    f"where shot {refused.shot} agrees with it",
                )
        return None
