"""Keeps count of a run and tells whoever watches it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from campaigns.measuring.progress import EngineState, Known, Progress, Watcher, time_left_s
from campaigns.measuring.steps import Step

FOLLOWERS: Mapping[EngineState, frozenset[EngineState]] = {
    EngineState.IDLE: frozenset({EngineState.MOVING, EngineState.FINISHED}),
    EngineState.MOVING: frozenset({EngineState.SETTLING}),
    EngineState.SETTLING: frozenset({EngineState.MEASURING}),
    EngineState.MEASURING: frozenset({EngineState.IDLE, EngineState.SUSPENDED}),
    EngineState.SUSPENDED: frozenset({EngineState.IDLE}),
    EngineState.STOPPED: frozenset(),
    EngineState.FINISHED: frozenset(),
}
"""What may come after what; `STOPPED` may come after anything."""


@dataclass(frozen=True, slots=True)
class ShotNews:
    """What an accepted shot adds to the progress."""

    seconds: float
    residual_mm: float | None
    drift_mm: float | None


class Tally:
    """The state of a run, checked against what may follow what."""

    def __init__(
        self, watcher: Watcher, *, done: int, total: int, goal_mm: float | None = None
    ) -> None:
        self._watcher = watcher
        self._progress = Progress(done, total, EngineState.IDLE, goal_mm=goal_mm)
        self._seconds: list[float] = []

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

    def see_beam(self, *, locked: bool) -> None:
        """Whether the tracker has its reflector, as far as is known."""
        self._progress = replace(self._progress, beam_locked=locked)

    def accept(self, news: ShotNews) -> None:
        """A shot counts."""
        self._seconds.append(news.seconds)
        done = self._progress.done + 1
        drift = self._progress.drift_mm if news.drift_mm is None else news.drift_mm
        self._tell(
            replace(
                self._progress,
                done=done,
                eta_s=time_left_s(self._seconds, self._progress.total - done),
                residual_mm=news.residual_mm,
                drift_mm=drift,
            )
        )

    def know(self, known: Known | None) -> None:
        """What the shots that count tell."""
        self._progress = replace(self._progress, known=known)

    def leave_out(self, shots: int) -> None:
        """Shots of the plan that need not be taken."""
        self._progress = replace(self._progress, total=self._progress.total - shots)

    def void(self, shots: int) -> None:
        """Shots that had counted do so no more."""
        self._progress = replace(self._progress, done=self._progress.done - shots)

    def event(self, text: str) -> None:
        """Something that the operator should read."""
        self._watcher.event(text)

    def _tell(self, progress: Progress) -> None:
        self._progress = progress
        self._watcher.progress(progress)
