"""Recovery from a shot that contradicts those before: who is suspected, as the loop then obeys."""

from dataclasses import dataclass

from campaigns.journal.records import Outcome
from campaigns.measuring.monitors import InnovationGate
from campaigns.measuring.stopping_rule import in_ranges

NOT_MOVING = "the robot does not move although its encoders say so"
ELSEWHERE = "the tracker is on a reflector that stands elsewhere"
LOOK_AT_THE_DRIVES = (
    "see whether the robot moves (couplings, brakes, drives), and put the beam onto its reflector "
    "by hand; then run again: it resumes"
)
SUSPECTS = 3
"""First shots that are measured again when a later one contradicts them."""


@dataclass(frozen=True, slots=True)
class Recovery:
    """What is to be done before the refused shot is measured again.

    Of nothing: the beam is brought back to where the reflector was seen.
    """

    void: tuple[Outcome, ...] = ()
    """Shots of a reflector that stands still, not to count; then the robot's is to be found."""
    why: str = ""
    suspects: tuple[Outcome, ...] = ()
    """First shots to be measured again and compared, the likeliest to be wrong first."""


def recovery(gate: InnovationGate, refused: Outcome) -> Recovery:
    """Recovery by the shots that count: is it they, the refused one, or the beam."""
    standing = gate.standing(refused)
    if not standing:
        return Recovery(suspects=gate.suspects(refused)[:SUSPECTS])
    shots = sorted((*(each.shot for each in standing), refused.shot))
    text = f"shots {in_ranges(shots)} have one point, although the encoders moved between them"
    return Recovery(void=standing, why=text)
