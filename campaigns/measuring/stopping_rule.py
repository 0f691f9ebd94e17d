"""How surely the parameters shall be known before measuring may end: `σ=0.02`."""

import math
import re
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from campaigns.errors import OptionsInvalid, PlanInvalid
from campaigns.journal.records import Event
from campaigns.measuring.run_state import ParameterUncertainty
from campaigns.measuring.uncertainty_monitor import UncertaintyMonitor
from campaigns.planning.steps import Group
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Vector3

LARGEST_MM = 10.0
"""No calibration is asked for less than this."""
_GOAL = re.compile(r"(?:σ|sigma|std)\s*=\s*(?P<number>\S+)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class UncertaintyGoal:
    """What must hold for every length that is identified."""

    std_mm: float
    """1 σ."""

    def __str__(self) -> str:
        """As it is typed."""
        return f"σ={self.std_mm:g}"


def read_goal(text: str) -> UncertaintyGoal:
    """From `σ=0.02` or `sigma=0.02`, in mm; raises `OptionsInvalid`."""
    matched = _GOAL.fullmatch(text.strip())
    if matched is None:
        raise OptionsInvalid(
            f"goal '{text}' is not understood", remedy="give a standard deviation, as σ=0.02 (mm)"
        )
    std_mm = _number(matched["number"])
    if not 0.0 < std_mm <= LARGEST_MM:
        raise OptionsInvalid(
            f"goal σ is {matched['number']}, must be above 0 and at most {LARGEST_MM:g} mm",
            remedy="give the standard deviation of the worst length, as σ=0.02 (mm)",
        )
    return UncertaintyGoal(std_mm)


def _number(text: str) -> float:
    """NaN, which no limit admits, for what is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def is_met(goal: UncertaintyGoal | None, known: ParameterUncertainty | None) -> bool:
    """Whether enough is known; without a goal it never is."""
    return goal is not None and known is not None and known.length_std_mm <= goal.std_mm


def early_stop(
    goal: UncertaintyGoal | None, known: ParameterUncertainty | None, left: Sequence[Group]
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
        f"goal {goal} met by {known.shots} shots: every length to ±{known.length_std_mm:.4f} mm, "
        f"positions to ±{known.position_std_mm:.4f} mm; "
        f"{len(shots)} shots left out: {in_ranges(shots)}"
    )
    wanted = tuple(group for group in left if not _only_identifies(group))
    return wanted, Event("goal met", text)


def predicted_stop(
    goal: UncertaintyGoal, monitor: UncertaintyMonitor, tracker_mm: Vector3
) -> tuple[ParameterUncertainty, int]:
    """What the whole plan will tell, seen from there, and how many shots will do for the goal.

    If they scatter only as the tracker states; shots to identify from, in the order of the plan.
    Raises `PlanInvalid` when even the whole of it will not meet the goal.
    """
    whole = monitor.predicted(tracker_mm)
    if whole is None or not is_met(goal, whole):
        raise PlanInvalid(
            f"goal {goal}: the whole plan "
            + (
                "has too few shots to identify from, or they cannot determine all parameters"
                if whole is None
                else f"will give {whole.length_std_mm:.3g} mm"
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
