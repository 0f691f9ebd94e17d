"""How surely the parameters shall be known before measuring may end: `σ=0.02`."""

import math
import re
from dataclasses import dataclass

from campaigns.errors import GoalInvalid

LARGEST_MM = 10.0
"""No calibration is asked for less than this."""
_GOAL = re.compile(r"(?:σ|sigma|std)\s*=\s*(?P<number>\S+)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Goal:
    """What must hold for every length that is identified."""

    std_mm: float
    """1 σ."""

    def __str__(self) -> str:
        """As it is typed."""
        return f"σ={self.std_mm:g}"


def read_goal(text: str) -> Goal:
    """From `σ=0.02` or `sigma=0.02`, in mm; raises `GoalInvalid`."""
    matched = _GOAL.fullmatch(text.strip())
    if matched is None:
        raise GoalInvalid(
            f"goal '{text}' is not understood", remedy="give a standard deviation, as σ=0.02 (mm)"
        )
    std_mm = _number(matched["number"])
    if not 0.0 < std_mm <= LARGEST_MM:
        raise GoalInvalid(
            f"goal σ is {matched['number']}, must be above 0 and at most {LARGEST_MM:g} mm",
            remedy="give the standard deviation of the worst length, as σ=0.02 (mm)",
        )
    return Goal(std_mm)


def _number(text: str) -> float:
    """NaN, which no limit admits, for what is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan
