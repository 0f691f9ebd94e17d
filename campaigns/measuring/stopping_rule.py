"""How surely positions shall be known before measuring may end: `--until 0.02`."""

import math
import re
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from campaigns.errors import OptionsInvalid, PlanInvalid
from campaigns.files.wording import shown
from campaigns.journal.records import Event
from campaigns.measuring.run_state import PositionUncertainty
from campaigns.measuring.uncertainty_monitor import UncertaintyMonitor
from campaigns.planning.steps import Group
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Vector3

LARGEST_MM = 10.0
"""No calibration is asked for less than this."""
_GOAL = re.compile(r"(?:(?:σ|s|sigma|std)\s*=\s*)?(?P<number>[^\s=]+?)\s*(?:mm)?", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class UncertaintyGoal:
    """Mean 1 σ of positions over the workspace that ends a run, mm."""

    std_mm: float

    def __str__(self) -> str:
        """Write it as it is typed."""
        return f"{self.std_mm:g}"


def read_goal(text: str) -> UncertaintyGoal:
    """Read a goal such as `0.02` (mm), `0.02 mm` or `σ=0.02`; raise `OptionsInvalid`."""
    matched = _GOAL.fullmatch(text.strip())
    std_mm = math.nan if matched is None else _number(matched["number"])
    if not 0.0 < std_mm <= LARGEST_MM:
        raise OptionsInvalid(
            f"--until is '{shown(text)}', must be above 0 and at most {LARGEST_MM:g} mm",
            remedy="give the mean σ of positions in mm, such as 0.02",
        )
    return UncertaintyGoal(std_mm)


def _number(text: str) -> float:
    """NaN, which no limit admits, for what is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def is_met(goal: UncertaintyGoal | None, known: PositionUncertainty | None) -> bool:
    """Whether enough is known; without a goal it never is."""
    return goal is not None and known is not None and known.position_std_mm <= goal.std_mm


def early_stop(
    goal: UncertaintyGoal | None, known: PositionUncertainty | None, left: Sequence[Group]
) -> tuple[tuple[Group, ...], Event] | None:
    """What serves something else than to identify, and what the journal says of the others.

    None when all of these groups are wanted.
    """
    if goal is None or known is None or not is_met(goal, known):
        return None
    superfluous = [group for group in left if _only_identifies(group)]
    if not superfluous:
        return None
    shots = sorted(step.planned.shot for group in superfluous for step in group)
    text = (
        f"goal {goal} mm met by {known.shots} shots: positions to ±{known.position_std_mm:.4f} mm; "
        f"{len(shots)} shots left out: {in_ranges(shots)}"
    )
    wanted = tuple(group for group in left if not _only_identifies(group))
    return wanted, Event("goal met", text)


def predicted_stop(
    goal: UncertaintyGoal, monitor: UncertaintyMonitor, tracker_mm: Vector3
) -> tuple[PositionUncertainty, int]:
    """What the whole plan will tell, seen from there, and how many shots will do for the goal.

    If they scatter only as the tracker states; shots to identify from, in the order of the plan.
    Raises `PlanInvalid` when even the whole of it will not meet the goal.
    """
    whole = monitor.predicted(tracker_mm)
    if whole is None or not is_met(goal, whole):
        raise PlanInvalid(
            f"goal {goal} mm: the whole plan "
            + (
                "has too few shots to identify from"
                if whole is None
                else f"will give {whole.position_std_mm:.3g} mm"
            ),
            remedy=f"plan more shots, with `pkmcal plan --until {goal}`, or ask for less; foreseen "
            "for a tracker as stated by tracker.uncertainty in campaign.yaml",
        )
    counts = range(1, whole.shots + 1)
    fewest = bisect_left(
        counts, x=True, key=lambda count: is_met(goal, monitor.predicted(tracker_mm, count))
    )
    return whole, counts[fewest]


def in_ranges(numbers: Sequence[int]) -> str:
    """Increasing numbers, short: `3–5, 8`."""
    runs = [
        [number for _, number in run]
        for _, run in groupby(enumerate(numbers), key=lambda placed: placed[1] - placed[0])
    ]
    return ", ".join(f"{run[0]}–{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)


def in_words(shots: Sequence[int]) -> str:
    """`shot 3`, `shots 3–5, 8`."""
    return f"shot{'s' if len(shots) > 1 else ''} {in_ranges(sorted(shots))}"


def _only_identifies(group: Group) -> bool:
    return all(step.planned.purpose is ShotSet.IDENTIFICATION for step in group)
