"""Run state: what a run shows while it runs, and what its operator may ask for meanwhile."""

from collections import deque
from collections.abc import Collection
from dataclasses import dataclass, replace
from enum import Enum
from threading import Lock

import numpy as np

from campaigns.planning.steps import Step

LATEST_SHOTS = 200
"""Shots by whose pace the end is estimated."""


class EngineState(Enum):
    """Where the engine stands; the value is the word on the screen."""

    IDLE = "idle"
    MOVING = "moving"
    SETTLING = "settling"
    MEASURING = "measuring"
    SUSPENDED = "suspended"
    PAUSED = "paused"
    STOPPED = "stopped"
    FINISHED = "finished"


@dataclass(frozen=True, slots=True)
class PositionUncertainty:
    """Uncertainty (1 σ) that the identification shots so far give."""

    shots: int
    weakest: str
    """Length that is known worst."""
    weakest_std_mm: float
    position_std_mm: float
    """Of positions all over the workspace, on average, after the best fit of their frame."""
    scatter_mm: float = 0.0
    """Scatter of the robot's point beside the tracker's noise; 0 where none was fitted."""


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
    beam_lost_s: float = 0.0
    """How long the beam has been broken."""
    beam_advice: str = ""
    """What the operator can do about it; empty before it was looked for in vain."""
    known: PositionUncertainty | None = None
    goal_mm: float | None = None
    """σ of positions at which measuring may end; None when all shall be measured."""


class RunObserver:
    """Display of a run, this one of nothing; it must not raise nor take long."""

    def progress(self, progress: Progress) -> None:
        """Show that the run has moved on."""

    def event(self, text: str) -> None:
        """Show what has happened; it is in the journal too."""


SILENT = RunObserver()
"""For runs without a screen."""


def time_left_s(shot_seconds: Collection[float], shots_left: int) -> tuple[float, float] | None:
    """Estimate the rest by the shots so far: the mean ± two standard deviations, s."""
    if len(shot_seconds) < 3:
        return None
    seconds = np.fromiter(shot_seconds, np.float64)
    mean = float(seconds.mean())
    deviation, count = float(seconds.std(ddof=1)), len(seconds)
    spread = 2.0 * deviation * (shots_left + shots_left**2 / count) ** 0.5
    return max(0.0, shots_left * mean - spread), shots_left * mean + spread


class RunState:
    """The state of a run, and its progress for its display."""

    def __init__(
        self, observer: RunObserver, *, done: int, total: int, goal_mm: float | None = None
    ) -> None:
        self._observer = observer
        self._progress = Progress(done, total, EngineState.IDLE, goal_mm=goal_mm)
        self._seconds: deque[float] = deque(maxlen=LATEST_SHOTS)

    def begin(self, step: Step) -> None:
        """Show the shot whose attempt begins."""
        planned = step.planned
        self._progress = replace(self._progress, shot=planned.shot, purpose=planned.purpose.value)

    def enter(self, state: EngineState) -> None:
        """Show another state."""
        self._tell(replace(self._progress, state=state))

    def rest(self) -> None:
        """Show that nothing is done now, whatever was before."""
        if self._progress.state is not EngineState.IDLE:
            self.enter(EngineState.IDLE)

    def see_beam(self, *, locked: bool, lost_s: float = 0.0, advice: str = "") -> None:
        """Note whether the tracker has its reflector, and for how long it has not."""
        progress = replace(
            self._progress, beam_locked=locked, beam_lost_s=lost_s, beam_advice=advice
        )
        if lost_s > 0.0:
            self._tell(progress)  # somebody may be waiting for a sign of life
        self._progress = progress

    def accept(self, seconds: float, residual_mm: float | None, drift_mm: float | None) -> None:
        """Count a shot, and show when the run will end."""
        self._seconds.append(seconds)
        now, done = self._progress, self._progress.done + 1
        self._tell(
            replace(
                now,
                done=done,
                eta_s=time_left_s(self._seconds, now.total - done),
                residual_mm=residual_mm,
                drift_mm=now.drift_mm if drift_mm is None else drift_mm,
            )
        )

    def update(self, uncertainty: PositionUncertainty | None) -> None:
        """Show the uncertainty by the shots that count."""
        self._progress = replace(self._progress, known=uncertainty)

    def leave_out(self, shots: int) -> None:
        """Take shots of the plan out of the total."""
        self._progress = replace(self._progress, total=self._progress.total - shots)

    def void(self, shots: int) -> None:
        """Take shots that do not count any more out of those done."""
        self._progress = replace(self._progress, done=self._progress.done - shots)

    def _tell(self, progress: Progress) -> None:
        self._progress = progress
        self._observer.progress(progress)


class Wish(Enum):
    """What the operator may ask for beside a stop, applied where the robot stands still."""

    PAUSE = "pause"
    """After this pair; asked for again, it goes on."""
    SKIP = "skip"
    """The shot that is being moved to or looked for is left out, and its pair."""
    AGAIN = "again"
    """The last shot, of a pair the pair, does not count and is measured again."""
    PARK = "park"
    """After this pair the robot goes where somebody can reach the reflector, and waits there."""


class Wishes:
    """Wishes asked for by any thread, each applied once."""

    def __init__(self) -> None:
        self._asked: set[Wish] = set()
        self._lock = Lock()

    def ask(self, wish: Wish) -> None:
        """Ask for something; a second time before it is applied changes nothing."""
        with self._lock:
            self._asked.add(wish)

    def take(self, wish: Wish) -> bool:
        """Return whether it was asked for since it was taken last."""
        with self._lock:
            is_asked = wish in self._asked
            self._asked.discard(wish)
            return is_asked
