"""Results of tasks, whoever works: what came of each, or why it was lost."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from drivers.errors import ExplainedError

Task = TypeVar("Task")
Outcome = TypeVar("Outcome")
Work = Callable[[Task], tuple[Outcome, ...]]


@dataclass(frozen=True, slots=True)
class Done(Generic[Outcome]):
    """Outcomes of a task, which is told by its place among all."""

    place: int
    outcomes: tuple[Outcome, ...]


@dataclass(frozen=True, slots=True)
class Lost:
    """Task that no worker came back with, and why."""

    place: int
    reason: str


Result = Done[Outcome] | Lost
Results = Generator[Result[Outcome], None, None]
"""As they come; closing it ends the work."""


class Workers(Protocol):
    """Whoever computes tasks."""

    def __call__(self, tasks: Sequence[Task], *, work: Work[Task, Outcome]) -> Results[Outcome]:
        """Results of tasks; raises `OptionsInvalid` at once when nobody is there to work."""


def tried(work: Work[Task, Outcome], place: int, task: Task) -> Result[Outcome]:
    """Result, made where the work is done: whatever goes wrong there costs this task alone."""
    try:
        return Done(place, work(task))
    except ExplainedError as error:
        return Lost(place, str(error))
    except Exception as error:  # noqa: BLE001 - it is told, and the task can be computed again
        return Lost(place, f"{type(error).__name__}: {error}")
