"""Run state: what a run shows while it runs, and the wishes of its operator meanwhile."""

from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from enum import Enum
from threading import Lock

import numpy as np

from campaigns.planning.steps import Step

LATEST_SHOTS = 200
"""Number of the latest shots by whose pace the end is estimated."""


class EngineState(Enum):
    """State of the engine; the value is the word on the screen."""

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
    """Uncertainty (1 σ) by the identification shots so far."""

    shots: int
    """Number of shots that the fit has kept."""
    weakest: str
    """Name of the length with the largest uncertainty; "" if the model has none."""
    weakest_std_mm: float
    position_std_mm: float
    """Of positions all over the workspace, on average, after the best fit of their frame."""
    scatter_mm: float = 0.0
    """Scatter of the robot's point beside the tracker's noise; 0 where none was fitted."""


@dataclass(frozen=True, slots=True)
class Progress:
    """One line of progress. Lengths in mm; None: not measured yet."""

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
    """Time for which the beam has been broken."""
    beam_advice: str = ""
    """Advice to the operator; "" until the reflector was searched for in vain."""
    uncertainty: PositionUncertainty | None = None
    """None: too few shots."""
    goal_mm: float | None = None
    """σ of positions at which measuring may end; None if all shots shall be measured."""
    counted: str = "shot"
    """Word for what is counted."""
    object: str = ""
    """Object that the shot or observation is of; "": the reflector of the robot file."""


class RunObserver:
    """Display of a run; this one shows nothing. Displays must not raise, nor take long."""

    def progress(self, progress: Progress) -> None:
        """Show that the run has moved on."""

    def event(self, text: str) -> None:
        """Show an event, which the journal has already."""


SILENT = RunObserver()
"""For runs without a screen."""


def time_left_s(shot_seconds: Collection[float], shots_left: int) -> tuple[float, float] | None:
    """Estimate the remaining time by the shots so far: mean ± two standard deviations, s."""
    # For n shots left and N measured, the variance is that of n shots, n s², plus that of n times a
    # mean of N shots, n² s² / N.
    if len(shot_seconds) < 3:
        return None
    seconds = np.fromiter(shot_seconds, np.float64)
    mean = float(seconds.mean())
    deviation, count = float(seconds.std(ddof=1)), len(seconds)
    spread = 2.0 * deviation * (shots_left + shots_left**2 / count) ** 0.5
    return max(0.0, shots_left * mean - spread), shots_left * mean + spread


class RunState:
    """State of a run, passed to its display whenever it changes."""

    def __init__(
        self,
        observer: RunObserver,
        *,
        done: int,
        total: int,
        goal_mm: float | None = None,
        counted: str = "shot",
    ) -> None:
        self._observer = observer
        self._progress = Progress(done, total, EngineState.IDLE, goal_mm=goal_mm, counted=counted)
        self._seconds: deque[float] = deque(maxlen=LATEST_SHOTS)

    def begin(self, step: Step) -> None:
        """Show the shot whose attempt begins."""
        planned = step.planned
        self._progress = replace(
            self._progress,
            shot=planned.shot,
            purpose=planned.purpose.value,
            object=planned.reflector,
        )

    def begin_observation(self, number: int, kind: str, of: str) -> None:
        """Show the observation, by its number from 1, that is made of an object."""
        self._progress = replace(self._progress, shot=number, purpose=kind, object=of)

    def accept_observation(self, number: int) -> None:
        """Count the observations up to this one."""
        self._show(replace(self._progress, done=number, state=EngineState.IDLE))

    def enter(self, state: EngineState) -> None:
        """Show another state."""
        self._show(replace(self._progress, state=state))

    def show_idle(self) -> None:
        """Show that nothing is done now, whatever was done before."""
        if self._progress.state is not EngineState.IDLE:
            self.enter(EngineState.IDLE)

    def see_beam(self, *, locked: bool, lost_s: float = 0.0, advice: str = "") -> None:
        """Note whether the tracker has its reflector, and for how long it has not."""
        progress = replace(
            self._progress, beam_locked=locked, beam_lost_s=lost_s, beam_advice=advice
        )
        if lost_s > 0.0:
            self._show(progress)  # somebody may be waiting for a sign of life
        self._progress = progress

    def accept(self, seconds: float, residual_mm: float | None, drift_mm: float | None) -> None:
        """Count a shot, and show when the run will end."""
        self._seconds.append(seconds)
        now, done = self._progress, self._progress.done + 1
        self._show(
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
        self._progress = replace(self._progress, uncertainty=uncertainty)

    def leave_out(self, shots: int) -> None:
        """Take shots of the plan out of the total."""
        self._progress = replace(self._progress, total=self._progress.total - shots)

    def void(self, shots: int) -> None:
        """Take shots that do not count any more out of those done."""
        self._progress = replace(self._progress, done=self._progress.done - shots)

    def _show(self, progress: Progress) -> None:
        self._progress = progress
        self._observer.progress(progress)


class Wish(Enum):
    """Wish of the operator beside a stop, applied only while the robot stands still."""

    PAUSE = "pause"
    """Wait after this pair; asked for again, go on."""
    SKIP = "skip"
    """Leave out the shot that is being moved to or looked for, and its pair."""
    AGAIN = "again"
    """Void the last shot, or its whole pair, and measure it again."""
    BACK = "back"
    """Leave the shot that is asked for now, void the last one, and measure both, that one first."""
    PARK = "park"
    """Go where somebody can reach the reflector after this pair, and wait there."""


class Wishes:
    """Wishes of the operator, asked for by any thread, each applied once.

    `stop_requested` is a function apart: a stop is looked at by every wait, and stays asked for.
    """

    def __init__(self, stop_requested: Callable[[], bool] = lambda: False) -> None:
        self.stop_requested = stop_requested
        self._asked: set[Wish] = set()
        self._lock = Lock()  # `ask` comes from the keyboard's thread

    def ask(self, wish: Wish) -> None:
        """Ask for a wish; a second time before it is applied changes nothing."""
        with self._lock:
            self._asked.add(wish)

    def take(self, wish: Wish) -> bool:
        """Return whether a wish was asked for since it was taken last."""
        with self._lock:
            is_asked = wish in self._asked
            self._asked.discard(wish)
            return is_asked
