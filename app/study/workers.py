"""Processes that simulate the campaigns of a study: of this computer, or of a Dask cluster."""

import os
import signal
import threading
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from importlib import import_module

from joblib import Parallel, delayed, parallel_config
from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import TerminatedWorkerError

from campaigns.errors import OptionsInvalid
from campaigns.studies.study import CampaignRow

PARENT_LOOKED_AFTER_S = 1.0
PARTS_A_ROUND = 64
"""Parts that a cluster computes before they are kept."""
KILLED = "a process that computed was killed"

Numbers = Sequence[int]
"""Of campaigns that one process simulates together."""
Simulate = Callable[[Numbers], tuple[CampaignRow, ...]]


@dataclass(frozen=True, slots=True)
class Part:
    """Campaigns that were simulated together, or why they were lost."""

    place: int
    """Among all parts."""
    rows: tuple[CampaignRow, ...] = ()
    lost: str = ""


Parts = Generator[Part, None, None]
"""As they come; closing it ends the work."""


def simulated_parts(simulate: Simulate, parts: Sequence[Numbers], processes: int) -> Parts:
    """Yield parts as they come from so many processes; a single one works in this process.

    When a process is killed, what had not come back is lost.
    """
    if processes == 1 or not parts:
        yield from (_tried(simulate, place, numbers) for place, numbers in enumerate(parts))
        return
    left = set(range(len(parts)))
    parallel = Parallel(
        n_jobs=processes,
        backend="loky",
        return_as="generator_unordered",
        batch_size=1,
        pre_dispatch=2 * processes,
        initializer=_serve,
        initargs=(os.getpid(),),
    )
    tasks = (delayed(_tried)(simulate, place, numbers) for place, numbers in enumerate(parts))
    try:
        for part in parallel(tasks):
            left.remove(part.place)
            yield part
    except TerminatedWorkerError:
        yield from (Part(place, lost=KILLED) for place in sorted(left))
    finally:
        get_reusable_executor().shutdown(wait=True)


def parts_of_cluster(simulate: Simulate, parts: Sequence[Numbers], scheduler: str) -> Parts:
    """Yield parts that the workers of a Dask scheduler at this URL simulate, a round at a time.

    Of a round in which a worker was lost for good, all is lost. Raise `OptionsInvalid` without
    Dask's `distributed` or when no scheduler answers.
    """
    with _client_of(scheduler) as client, parallel_config("dask", client=client):
        for first in range(0, len(parts), PARTS_A_ROUND):
            places = range(first, min(first + PARTS_A_ROUND, len(parts)))
            tasks = (delayed(_tried)(simulate, place, parts[place]) for place in places)
            try:
                yield from Parallel()(tasks)
            except Exception as error:  # noqa: BLE001 - Dask's own, such as KilledWorker
                why = f"{type(error).__name__}: {error}"
                yield from (Part(place, lost=why) for place in places)


def _client_of(scheduler: str) -> AbstractContextManager[object]:
    try:  # an extra that few install
        distributed = import_module("distributed")
        client: AbstractContextManager[object] = distributed.Client(scheduler)
    except ImportError:
        remedy = "pip install 'pkmcal[cluster]'"
        raise OptionsInvalid("--scheduler needs Dask", remedy=remedy) from None
    except (OSError, ValueError) as error:
        problem = f"--scheduler {scheduler}: no Dask scheduler answers: {error}"
        remedy = "start one with `dask scheduler`, its workers with `dask worker URL`"
        raise OptionsInvalid(problem, remedy=remedy) from error
    return client


def _tried(simulate: Simulate, place: int, numbers: Numbers) -> Part:
    """Simulate where the work is done: whatever goes wrong there costs this part alone."""
    try:
        return Part(place, simulate(numbers))
    except Exception as error:  # noqa: BLE001 - it is reported, and can be computed again
        return Part(place, lost=f"{type(error).__name__}: {error}")


def _serve(parent: int) -> None:
    """Let only the first process act on Ctrl-C, and end with it.

    Workers of one that was killed would wait for ever to hand over their results.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(PARENT_LOOKED_AFTER_S)
    os._exit(1)
