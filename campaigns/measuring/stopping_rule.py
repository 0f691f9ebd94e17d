"""Stopping rule: the uncertainty of positions that ends a run, `--until 0.02`.

A plan is made for the scatter that its author expects; a robot that scatters less needs fewer
shots. A goal is the mean standard deviation (1 σ, mm) of positions all over the workspace, as
`identify` will report it from the shots so far. When it is met, the run ends early.

Only shots that serve nothing but the identification are left out. Shots for validation, drift and
nests are measured nevertheless, and a pair is measured or left out as a whole: the rule shortens a
run, but takes nothing away from what checks its result.

Before the run, the uncertainty by the whole plan is predicted: a goal that it cannot meet is
refused before anything moves.
"""

import math
import re
from bisect import bisect_left
from collections.abc import Sequence
from itertools import groupby

from campaigns.errors import OptionsInvalid, PlanInvalid
from campaigns.files.wording import shown
from campaigns.measuring.run_state import PositionUncertainty
from campaigns.measuring.uncertainty_monitor import UncertaintyMonitor
from campaigns.planning.steps import Group
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Vector3

LARGEST_GOAL_MM = 10.0
"""Largest goal in mm; a larger number is a typing error."""
_GOAL = re.compile(r"(?:(?:σ|s|sigma|std)\s*=\s*)?(?P<number>[^\s=]+?)\s*(?:mm)?", re.IGNORECASE)


def read_goal(text: str) -> float:
    """Read a goal in mm such as `0.02`, `0.02 mm` or `σ=0.02`; raise `OptionsInvalid`."""
    matched = _GOAL.fullmatch(text.strip())
    std_mm = math.nan if matched is None else _number(matched["number"])
    if not 0.0 < std_mm <= LARGEST_GOAL_MM:
        raise OptionsInvalid(
            f"--until is '{shown(text)}', must be above 0 and at most {LARGEST_GOAL_MM:g} mm",
            remedy="give the mean σ of positions in mm, such as 0.02",
        )
    return std_mm


def _number(text: str) -> float:
    """Return a number, NaN for other text."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def is_met(goal_mm: float | None, uncertainty: PositionUncertainty | None) -> bool:
    """Return whether the uncertainty of positions meets the goal; without a goal it never does."""
    return (
        goal_mm is not None and uncertainty is not None and uncertainty.position_std_mm <= goal_mm
    )


def predicted_stop(
    goal_mm: float, monitor: UncertaintyMonitor, tracker_mm: Vector3
) -> tuple[PositionUncertainty, int]:
    """Return the uncertainty by the whole plan, and the number of shots that will meet the goal.

    The shots are those to identify from, in the order of the plan, with the noise that the tracker
    states. Raise `PlanInvalid` if even the whole plan will not meet the goal.
    """
    whole = monitor.predicted(tracker_mm)
    if whole is None or not is_met(goal_mm, whole):
        raise PlanInvalid(
            f"goal {goal_mm:g} mm: the whole plan "
            + (
                "has too few shots to identify from"
                if whole is None
                else f"will give {whole.position_std_mm:.3g} mm"
            ),
            remedy=f"plan more shots, with `pkmcal plan --until {goal_mm:g}`, or ask for less; "
            "foreseen for a tracker as stated by tracker.uncertainty in campaign.yaml",
        )
    # Each further shot lowers the uncertainty, so that the first count that suffices is found by
    # bisection: a forecast takes long.
    counts = range(1, whole.shots + 1)
    fewest = bisect_left(
        counts, x=True, key=lambda count: is_met(goal_mm, monitor.predicted(tracker_mm, count))
    )
    return whole, counts[fewest]


def in_ranges(numbers: Sequence[int]) -> str:
    """Write increasing numbers short: `3–5, 8`."""
    # In a run of consecutive numbers the difference between number and place is constant.
    runs = [
        [number for _, number in run]
        for _, run in groupby(enumerate(numbers), key=lambda placed: placed[1] - placed[0])
    ]
    return ", ".join(f"{run[0]}–{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)


def in_words(shots: Sequence[int]) -> str:
    """Name shots: `shot 3`, `shots 3–5, 8`."""
    return f"shot{'s' if len(shots) > 1 else ''} {in_ranges(sorted(shots))}"


def only_identifies(group: Group) -> bool:
    """Return whether a group serves nothing but the identification."""
    return all(step.planned.purpose is ShotSet.IDENTIFICATION for step in group)
