"""What comes back of a study's tasks, whoever works."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

from campaigns.studies.study import CampaignOutcome, StudyTask

Outcomes = tuple[CampaignOutcome, ...]
Work = Callable[[StudyTask], Outcomes]


@dataclass(frozen=True, slots=True)
class Done:
    """What came of a task, which is told by its place among all."""

    place: int
    outcomes: Outcomes


@dataclass(frozen=True, slots=True)
class Lost:
    """A task that no worker came back with, and why."""

    place: int
    reason: str


Result = Done | Lost
Results = Generator[Result, None, None]
"""As they come; closing it ends the work."""
ResultsOf = Callable[[Sequence[StudyTask]], Results]


def tried(work: Work, place: int, task: StudyTask) -> Result:
    """Made where the work is done: whatever goes wrong there costs this task alone."""
    try:
        return Done(place, work(task))
    except Exception as error:  # noqa: BLE001 - it is told, and the task can be computed again
        return Lost(place, f"{type(error).__name__}: {error}")
