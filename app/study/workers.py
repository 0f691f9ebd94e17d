"""Who computes tasks, a study's or a reproduction's: processes of this computer, or a Dask cluster.

Whoever it is, the numbers are the same; and when a worker dies, only what it was about is lost.
"""

import os
import signal
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

from joblib import Parallel, cpu_count, delayed
from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import TerminatedWorkerError

from app.study.cluster import cluster_results
from app.study.results import Outcome, Result, Results, Task, Work, Workers, tried
from campaigns.errors import OptionsInvalid

SCHEDULER = ("tcp://", "tls://")
AHEAD = 2
"""Tasks that each of several local processes has been given or waits for."""
PARENT_LOOKED_AFTER_S = 1.0


def workers_of(text: str | None) -> Workers:
    """Local processes for a number, one a processor for None, a cluster for its scheduler.

    Raises `OptionsInvalid` for anything else.
    """
    if text is None:
        return partial(local_results, processes=cpu_count())
    if text.startswith(SCHEDULER):
        return partial(cluster_results, scheduler=text)
    if text.isascii() and text.isdecimal() and int(text) > 0:
        return partial(local_results, processes=int(text))
    raise OptionsInvalid(
        f"--workers is '{text}'",
        remedy="give a number of local processes, or the scheduler's address as tcp://HOST:PORT",
    )


def local_results(
    tasks: Sequence[Task], processes: int, work: Work[Task, Outcome], *, apart: bool = False
) -> Results[Outcome]:
    """Results from so many processes; a single one works in this process unless `apart`.

    When a process dies, the tasks that may have been its own are tried again one by one, so that
    the one that kills is found out and the others are not lost with it.
    """
    if not tasks or (processes == 1 and not apart):
        yield from (tried(work, place, task) for place, task in enumerate(tasks))
        return
    left = dict(enumerate(tasks))
    try:
        while left:
            try:
                yield from _taken_off(left, _parallel(work, left, processes))
            except TerminatedWorkerError:
                for place in list(left)[: AHEAD * processes]:
                    yield _alone(work, place, left.pop(place))
    finally:
        get_reusable_executor().shutdown(wait=True)


def _taken_off(
    left: dict[int, Task], results: Iterator[Result[Outcome]]
) -> Iterator[Result[Outcome]]:
    for result in results:
        del left[result.place]
        yield result


def _alone(work: Work[Task, Outcome], place: int, task: Task) -> Result[Outcome]:
    """Result from a process of its own, which may die."""
    try:
        return next(_parallel(work, {place: task}, 1))
    except TerminatedWorkerError:
        return Result(place, lost="the process that computed it was killed")


def _parallel(
    work: Work[Task, Outcome], tasks: Mapping[int, Task], processes: int
) -> Iterator[Result[Outcome]]:
    """Results as they come; joblib would take this process for a single one, so it is given two."""
    parallel = Parallel(
        n_jobs=max(processes, 2),
        backend="loky",
        return_as="generator_unordered",
        batch_size=1,
        pre_dispatch=AHEAD * processes if processes > 1 else 1,
        initializer=_serve,
        initargs=(os.getpid(),),
    )
    items = list(tasks.items())  # the caller takes off what has come back
    return iter(parallel(delayed(tried)(work, place, task) for place, task in items))


def _serve(parent: int) -> None:
    """What a local process begins with: only the first one acts on Ctrl-C, and all end with it.

    Workers of one that was killed would wait for ever to hand over their results.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(PARENT_LOOKED_AFTER_S)
    os._exit(1)
