"""What a run tells about itself while it runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np

SHOTS_FOR_AN_ESTIMATE = 3


class EngineState(Enum):
    """Where the engine stands; the value is the word on the screen."""

    IDLE = "idle"
    MOVING = "moving"
    SETTLING = "settling"
    MEASURING = "measuring"
    SUSPENDED = "suspended"
    STOPPED = "stopped"
    FINISHED = "finished"


@dataclass(frozen=True, slots=True)
class Known:
    """How surely the identification shots so far tell the parameters: 1 σ."""

    shots: int
    weakest: str
    """The parameter known worst; angles are compared by what they do at the arm's end."""
    weakest_std: float
    """In the unit of its name, mm or deg."""
    length_std_mm: float
    """Of the length known worst: what a goal is about."""
    position_std_mm: float
    """Of positions all over the workspace, on average, after the best fit of their frame."""
    scatter: float
    """What the best fit leaves of the shots, over what the tracker states of them."""
    scale: float = 1.0
    """What every σ was multiplied by for it; 1 while it may be chance."""

    @property
    def unit(self) -> str:
        """Of `weakest_std`."""
        return self.weakest.rpartition("_")[2]


@dataclass(frozen=True, slots=True)
class Progress:
    """One line of progress. Lengths in mm; None is not known yet."""

    done: int
    total: int
    state: EngineState
    shot: int | None = None
    purpose: str = ""
    eta_s: tuple[float, float] | None = None
    residual_mm: float | None = None
    drift_mm: float | None = None
    beam_locked: bool = True
    known: Known | None = None
    goal_mm: float | None = None
    """σ of the worst length at which measuring may end; None when all shall be measured."""


class Watcher(Protocol):
    """Whoever shows a run; must not raise and must not take long."""

    def progress(self, progress: Progress) -> None:
        """The run has moved on."""
        ...

    def event(self, text: str) -> None:
        """Something happened that the operator should read."""
        ...


def time_left_s(shot_seconds: Sequence[float], shots_left: int) -> tuple[float, float] | None:
    """An interval for the rest, from the shots so far: the mean ± two standard deviations."""
    if len(shot_seconds) < SHOTS_FOR_AN_ESTIMATE:
        return None
    seconds = np.array(shot_seconds)
    mean = float(seconds.mean())
    spread = (
        2.0 * float(seconds.std(ddof=1)) * (1.0 / shots_left + 1.0 / len(seconds)) ** 0.5
        if shots_left
        else 0.0
    )
    return max(0.0, shots_left * (mean - spread)), shots_left * (mean + spread)
