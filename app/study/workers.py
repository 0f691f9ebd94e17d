"""Who computes a study: processes of this computer, or an existing Dask cluster.

Whoever it is, the numbers are the same; and when a worker dies, only what it was about is lost.
"""

import importlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from joblib import Parallel, delayed
from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import TerminatedWorkerError

from app.errors import UsageInvalid
from campaigns.study import CampaignOutcome, StudyTask, run_task

CONNECT_S = 10.0
AHEAD = 2
"""Tasks that each local process has been given or waits for."""


@dataclass(frozen=True, slots=True)
class Lost:
    """Campaigns that no worker came back with, and why."""

    numbers: tuple[int, ...]
    reason: str


Outcomes = tuple[CampaignOutcome, ...]
Result = Outcomes | Lost
Work = Callable[[StudyTask], Outcomes]


def local_results(
    tasks: Sequence[StudyTask], processes: int, work: Work = run_task
) -> Iterator[Result]:
    """Results as they come, from so many processes; one works in this process.

    When a process dies, the tasks that may have been its own are tried again one by one, so that
    the one that kills is found out and the others are not lost with it.
    """
    if processes == 1:
        yield from map(work, tasks)
        return
    left = {task.numbers: task for task in tasks}
    try:
        while left:
            try:
                yield from _taken_off(left, _parallel(work, list(left.values()), processes))
            except TerminatedWorkerError:
                for numbers in list(left)[: AHEAD * processes]:
                    yield _alone(work, left.pop(numbers))
    finally:
        get_reusable_executor().shutdown(wait=True)


def _taken_off(
    left: dict[tuple[int, ...], StudyTask], results: Iterator[Outcomes]
) -> Iterator[Result]:
    for outcomes in results:
        del left[tuple(outcome.number for outcome in outcomes)]
        yield outcomes


def _alone(work: Work, task: StudyTask) -> Result:
    """In a process of its own, which may die."""
    try:
        return next(_parallel(work, [task], 2))
    except TerminatedWorkerError:
        return Lost(task.numbers, "the process that computed it was killed")


def _parallel(work: Work, tasks: Sequence[StudyTask], processes: int) -> Iterator[Outcomes]:
    parallel = Parallel(
        n_jobs=processes,
        backend="loky",
        return_as="generator_unordered",
        batch_size=1,
        pre_dispatch=AHEAD * processes,
    )
    return iter(parallel(delayed(work)(task) for task in tasks))


def cluster_results(
    tasks: Sequence[StudyTask], scheduler: str, work: Work = run_task
) -> Iterator[Result]:
    """Results as they come, from a Dask cluster whose workers have pkmcal installed too.

    Raises `UsageInvalid` at once when Dask is not installed or no scheduler answers.
    """
    try:
        distributed = importlib.import_module("distributed")
    except ImportError as error:
        raise UsageInvalid(
            "--workers names a scheduler, but Dask is not installed",
            remedy="install pkmcal[cluster], or give a number of local processes",
        ) from error
    try:
        client = distributed.Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UsageInvalid(
            f"no Dask scheduler answers at {scheduler}",
            remedy="check the address and that the scheduler runs, or give a number of processes",
        ) from error
    return _from_cluster(distributed.as_completed, client, tasks, work)


def _from_cluster(
    as_completed: Callable[..., Any], client: Any, tasks: Sequence[StudyTask], work: Work
) -> Iterator[Result]:
    """Dask itself tries again what was with a worker that died, three times."""
    with client:
        numbers = {client.submit(work, task, pure=False): task.numbers for task in tasks}
        completed = as_completed(list(numbers), loop=client.loop)
        for future in completed:
            if future.status == "lost":  # its worker died with the result: it is computed again
                completed.add(future)
                continue
            missing = numbers.pop(future)  # and with the future what the cluster keeps of it
            if future.status == "finished":
                yield future.result()
            else:
                yield Lost(missing, _reason(future))


def _reason(future: Any) -> str:
    error = future.exception() if future.status == "error" else future.status
    return f"{type(error).__name__}: {error}" if isinstance(error, Exception) else str(error)
