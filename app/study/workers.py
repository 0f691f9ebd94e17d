"""Processes of this computer that compute the tasks of a study."""

import os
import signal
import threading
import time
from collections.abc import Iterator, Sequence

from joblib import Parallel, delayed
from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import TerminatedWorkerError

from app.study.results import Outcome, Result, Results, Task, Work, tried

PARENT_LOOKED_AFTER_S = 1.0
KILLED = "a process that computed was killed"


def local_results(
    tasks: Sequence[Task], processes: int, work: Work[Task, Outcome]
) -> Results[Outcome]:
    """Yield results as they come from so many processes.

    A single one works in this process. When a process is killed, what had not come back is lost.
    """
    if not tasks or processes == 1:
        yield from (tried(work, place, task) for place, task in enumerate(tasks))
        return
    left = set(range(len(tasks)))
    try:
        for result in _parallel(work, tasks, processes):
            left.remove(result.place)
            yield result
    except TerminatedWorkerError:
        yield from (Result(place, lost=KILLED) for place in sorted(left))
    finally:
        get_reusable_executor().shutdown(wait=True)


def _parallel(
    work: Work[Task, Outcome], tasks: Sequence[Task], processes: int
) -> Iterator[Result[Outcome]]:
    """Yield results as they come."""
    parallel = Parallel(
        n_jobs=processes,
        backend="loky",
        return_as="generator_unordered",
        batch_size=1,
        pre_dispatch=2 * processes,
        initializer=_serve,
        initargs=(os.getpid(),),
    )
    return iter(parallel(delayed(tried)(work, place, task) for place, task in enumerate(tasks)))


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
