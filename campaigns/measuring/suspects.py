"""Suspects: which shot is wrong, the refused one or an earlier one that it contradicts.

A shot is refused because it contradicts the accepted ones, which does not show which of them is
wrong: the beam may be on another reflector now, or may have been when the first shots were taken.
So the cell measures again instead of guessing.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from math import dist

from campaigns.journal.records import Outcome
from campaigns.measuring.beam import Beam, one_point_error, one_point_text
from campaigns.measuring.gate import WRONG_POINT
from campaigns.measuring.results import Accepted, Refused
from campaigns.measuring.shot_taker import ShotTaker
from campaigns.measuring.work import Session
from campaigns.planning.steps import Group

MOST_SUSPECTS = 3
"""Largest number of earlier shots that are measured again because of one refused shot."""


class Suspects:
    """Finds out which shots are wrong by measuring again, and voids them."""

    def __init__(
        self,
        session: Session,
        shots: ShotTaker,
        beam: Beam,
        void_shot: Callable[[Outcome, str], Group],
    ) -> None:
        """`void_shot` voids a shot for a reason, and returns its group, () if the plan has none."""
        self._work, self._rules, self._gate = session.work, session.work.rules, session.gate
        self._shots, self._beam, self._void_shot = shots, beam, void_shot
        self._compared: set[int] = set()
        """Earlier shots that were measured again to compare them."""
        self._looked_back: Counter[int] = Counter()
        """Number of searches for the robot's reflector, by the shot that was refused."""

    def void_wrong_shots(self, refused: Outcome) -> tuple[Group, ...] | None:
        """Void accepted shots that turn out wrong because a right one was refused.

        Return those of their groups that the plan still has; None if no shot is wrong. Raise
        `GateRefused` if the beam cannot be brought back onto the robot's reflector.
        """
        # The certain case first, which needs no motion: accepted shots have the refused one's very
        # point, although the robot was elsewhere. All of them are of a reflector that stands still.
        #
        # Otherwise a shot without which the refused one agrees with all others is measured again.
        # It is voided only if the repetition lies elsewhere and agrees.
        if standing := self._gate.find_standing(refused):
            return self._void_standing(refused, standing)
        for suspect in self._gate.find_suspects(refused)[:MOST_SUSPECTS]:
            if (reason := self._measure_suspect(suspect, refused)) is not None:
                return (self._void_shot(suspect, reason),)
        return None

    def regain_reflector(self, refused: Refused) -> bool:
        """Bring robot and beam together at a pose before; return whether that has succeeded.

        False also if a reflector was found where this pose's should be, or too many searches for
        this shot have not helped.
        """
        shot = refused.outcome.shot
        if refused.relocked or self._looked_back[shot] >= self._rules.gate.attempts - 1:
            return False
        self._looked_back[shot] += 1
        return self._beam.look_back()

    def _void_standing(self, refused: Outcome, standing: Sequence[Outcome]) -> tuple[Group, ...]:
        """Void shots of a reflector that stands elsewhere, and look for the robot's.

        Return the groups of the voided shots that the plan still has. Raise `GateRefused` if the
        robot's reflector is not found.
        """
        same_point = (*standing, refused)
        reason = f"{one_point_text(same_point)}: a reflector that stands elsewhere"
        voided: list[Group] = []
        for shot in standing:
            # A shot that counts no more was voided with its partner. A group is () if its row was
            # removed from the plan.
            if shot in self._gate.accepted and (group := self._void_shot(shot, reason)):
                voided.append(group)
        if not self._beam.look_back(refused.point_in_tracker_mm):
            raise one_point_error(same_point)
        return tuple(voided)

    def _measure_suspect(self, suspect: Outcome, refused: Outcome) -> str | None:
        """Measure a suspect again, once; return why it is wrong, None if it is not."""
        step = next((s for s in self._work.steps if s.planned.shot == suspect.shot), None)
        # There is no step if its row was removed from the plan. Once in a session, or two shots
        # that accuse each other would be measured for ever.
        if step is None or suspect.shot in self._compared:
            return None
        self._compared.add(suspect.shot)
        # Not judged: the gate rests on the suspect itself, and would refuse a right repetition.
        result = self._shots.retry(partial(self._shots.take, step, is_judged=False))
        if not isinstance(result, Accepted):
            return None
        repeat = result.outcome
        away_mm = dist(suspect.point_in_tracker_mm, repeat.point_in_tracker_mm)
        # The repetition itself never counts: both shots of a pair have to be of one time, so that
        # the suspect's whole group is measured again if it is voided.
        self._shots.compare_only(
            repeat, f"only compared with the one before, {away_mm:.3f} mm away"
        )
        reason = f"{WRONG_POINT}: measured again it is {away_mm:.1f} mm away"
        is_replaced = self._gate.is_replaced_by(repeat, suspect, refused)
        return f"{reason}, where shot {refused.shot} agrees with it" if is_replaced else None
