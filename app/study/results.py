"""Results of tasks, whoever works: what came of each, or why it was lost."""

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from drivers.errors import ExplainedError

Task = TypeVar("Task")
Outcome = TypeVar("Outcome")
Work = Callable[[Task], tuple[Outcome, ...]]


@dataclass(frozen=True, slots=True)
class Result(Generic[Outcome]):
    """Rows of a task, which is told by its place among all; or why no worker came back with it."""

    place: int
    rows: tuple[Outcome, ...] = ()
    lost: str = ""


Results = Generator[Result[Outcome], None, None]
"""As they come; closing it ends the work."""
Workers = Callable[..., Results[Any]]
"""Whoever computes: from tasks, and `work` by name, to results."""


def tried(work: Work[Task, Outcome], place: int, task: Task) -> Result[Outcome]:
    """Result, made where the work is done: whatever goes wrong there costs this task alone."""
    try:
        return Result(place, work(task))
    except ExplainedError as error:
        return Result(place, lost=str(error))
    except Exception as error:  # noqa: BLE001 - it is told, and the task can be computed again
        return Result(place, lost=f"{type(error).__name__}: {error}")
