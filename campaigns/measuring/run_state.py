"""Run state: what a run tells about itself while it runs."""

from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from campaigns.planning.steps import Step

SHOTS_FOR_AN_ESTIMATE = 3
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
    """Whoever shows a run, this one nothing; must not raise and must not take long."""

    def progress(self, progress: Progress) -> None:
        """The run has moved on."""

    def event(self, text: str) -> None:
        """Something happened that the operator should read; it is in the journal too."""


SILENT = RunObserver()
"""For runs that nobody watches."""


def time_left_s(shot_seconds: Collection[float], shots_left: int) -> tuple[float, float] | None:
    """An interval for the rest, from the shots so far: the mean ± two standard deviations."""
    if len(shot_seconds) < SHOTS_FOR_AN_ESTIMATE:
        return None
    seconds = np.fromiter(shot_seconds, np.float64)
    mean = float(seconds.mean())
    spread = (
        2.0 * float(seconds.std(ddof=1)) * (1.0 / shots_left + 1.0 / len(seconds)) ** 0.5
        if shots_left
        else 0.0
    )
    return max(0.0, shots_left * (mean - spread)), shots_left * (mean + spread)


FOLLOWERS: Mapping[EngineState, frozenset[EngineState]] = {
    EngineState.IDLE: frozenset({EngineState.MOVING, EngineState.PAUSED, EngineState.FINISHED}),
    EngineState.MOVING: frozenset({EngineState.SETTLING, EngineState.IDLE}),
    EngineState.SETTLING: frozenset(
        {EngineState.MEASURING, EngineState.SUSPENDED, EngineState.IDLE}
    ),
    EngineState.MEASURING: frozenset({EngineState.IDLE, EngineState.SUSPENDED}),
    EngineState.SUSPENDED: frozenset({EngineState.IDLE}),
    EngineState.PAUSED: frozenset({EngineState.IDLE}),
    EngineState.STOPPED: frozenset(),
    EngineState.FINISHED: frozenset(),
}
"""What may come after what; `STOPPED` may come after anything.

Idle after moving: the controller refused a target; after settling: the operator skips the shot, or
the robot is parked. Suspended after settling: the robot is back at a
pose where the reflector is looked for.
"""


class RunState:
    """The state of a run, checked against what may follow what."""

    def __init__(
        self, observer: RunObserver, *, done: int, total: int, goal_mm: float | None = None
    ) -> None:
        self._observer = observer
        self._progress = Progress(done, total, EngineState.IDLE, goal_mm=goal_mm)
        self._seconds: deque[float] = deque(maxlen=LATEST_SHOTS)

    def begin(self, step: Step) -> None:
        """A shot's attempt begins."""
        planned = step.planned
        self._progress = replace(self._progress, shot=planned.shot, purpose=planned.purpose.value)

    def enter(self, state: EngineState) -> None:
        """The engine goes on to another state; one that may not follow is a bug and says so."""
        now = self._progress.state
        if state is not EngineState.STOPPED and state not in FOLLOWERS[now]:
            raise AssertionError(f"{state.value} cannot follow {now.value}")
        self._tell(replace(self._progress, state=state))

    def rest(self) -> None:
        """The engine does nothing now, whatever it did before."""
        if self._progress.state is not EngineState.IDLE:
            self.enter(EngineState.IDLE)

    def see_beam(self, *, locked: bool, lost_s: float = 0.0, advice: str = "") -> None:
        """Whether the tracker has its reflector, as far as is known, or for how long it has not."""
        progress = replace(
            self._progress, beam_locked=locked, beam_lost_s=lost_s, beam_advice=advice
        )
        if lost_s > 0.0:
            self._tell(progress)  # somebody may be waiting for a sign of life
        self._progress = progress

    def accept(self, seconds: float, residual_mm: float | None, drift_mm: float | None) -> None:
        """A shot counts."""
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

    def update(self, known: PositionUncertainty | None) -> None:
        """What the shots that count tell."""
        self._progress = replace(self._progress, known=known)

    def leave_out(self, shots: int) -> None:
        """Shots of the plan that need not be taken."""
        self._progress = replace(self._progress, total=self._progress.total - shots)

    def void(self, shots: int) -> None:
        """Shots that had counted do so no more."""
        self._progress = replace(self._progress, done=self._progress.done - shots)

    def _tell(self, progress: Progress) -> None:
        self._progress = progress
        self._observer.progress(progress)
