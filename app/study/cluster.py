"""Tasks on an existing Dask cluster, whose workers have pkmcal installed too."""

import asyncio
import importlib
import logging
import pickle
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from functools import partial
from itertools import islice
from queue import Empty, Queue
from typing import Any
from uuid import uuid4

from app.study.results import Outcome, Portion, Result, Results, Task, Work, tried
from campaigns.errors import OptionsInvalid

LOGS = ("distributed", "distributed.client", "asyncio")
"""Of the client; each has a level of its own."""
AHEAD = 8
"""Tasks that the cluster has of a study for each of its threads: it need not hold a million."""
ANEW = 3
"""How often a task is given to the cluster anew when its result has gone."""


def cluster_results(
    tasks: Sequence[Task],
    scheduler: str,
    work: Work[Task, Outcome],
    *,
    connect_s: float = 5.0,
    result_s: float = 10.0,
    empty_s: float = 60.0,
) -> Results[Outcome]:
    """Results from the cluster of a scheduler, which is asked only if there is something to do.

    `connect_s` is waited for the scheduler to answer, and for a first worker; `result_s` for a
    finished result to come here, or be noticed to be gone; `empty_s` for any result, before it is
    asked whether there are workers at all.

    Raises `OptionsInvalid` at once when Dask is not installed or no scheduler or worker answers.
    """
    client = _connected(scheduler, connect_s) if tasks else nullcontext()
    return _from_cluster(client, tasks, work, result_s, empty_s)


def _connected(scheduler: str, within_s: float) -> Any:
    """Client of a cluster that has workers; raises `OptionsInvalid`."""
    try:
        distributed = importlib.import_module("distributed")
    except ImportError as error:
        raise OptionsInvalid(
            "--workers names a scheduler, but Dask is not installed",
            remedy="install pkmcal[cluster], or give a number of local processes",
        ) from error
    for name in LOGS:  # what matters of it becomes our words
        logging.getLogger(name).setLevel(logging.CRITICAL)

    async def ask() -> None:
        """Before there is a client, which after a failure would need as long again to clean up."""
        keys = distributed.Security().get_connection_args("client")
        answer = await distributed.comm.connect(scheduler, timeout=within_s, **keys)
        await answer.close()

    try:
        asyncio.run(asyncio.wait_for(ask(), within_s))
    except (OSError, ValueError, TypeError) as error:  # TypeError: keys for tls:// are missing
        raise OptionsInvalid(
            f"no Dask scheduler answers at {scheduler}",
            remedy="check the address and that the scheduler runs, or give a number of processes",
        ) from error
    client = distributed.Client(scheduler, timeout=within_s, set_as_default=False)
    try:
        client.wait_for_workers(1, timeout=within_s)
    except TimeoutError as error:
        client.close()
        raise OptionsInvalid(
            f"the Dask scheduler at {scheduler} has no workers",
            remedy=f"start some: dask worker {scheduler}, or give a number of local processes",
        ) from error
    return client


def _from_cluster(
    client: Any, tasks: Sequence[Task], work: Work[Task, Outcome], result_s: float, empty_s: float
) -> Results[Outcome]:
    """Results as they come; what the cluster keeps of a task goes with its future."""
    places: dict[Any, int] = {}
    suspects: list[int] = []
    ended: Queue[Any] = Queue()
    waiting = iter(range(len(tasks)))
    sent: dict[int, tuple[str, Any]] = {}

    def submit(place: int) -> None:
        future = _submitted(client, work, place, tasks[place], sent)
        places[future] = place
        future.add_done_callback(ended.put)

    def refill() -> int:
        """As many tasks as the cluster's threads, which come and go, now have use for."""
        most = AHEAD * max(_threads(client), 1)
        for place in islice(waiting, most - len(places)):
            submit(place)
        return most

    why = "the cluster has no workers left"
    with client:
        try:
            if tasks:
                next_ended = partial(_next, ended, empty_s, client)
                yield from _as_they_come(places, suspects, submit, refill, next_ended, result_s)
        except OSError:
            why = "the cluster's scheduler no longer answers"
    left = (*places.values(), *suspects, *waiting)
    yield from (Result(place, lost=why) for place in left)


def _submitted(
    client: Any, work: Work[Task, Any], place: int, task: Task, sent: dict[int, tuple[str, Any]]
) -> Any:
    """Future of a task's result; `sent` has by its id what portions share, a group's name first.

    A scheduler keeps the last thousand messages to each process, so they stay small: what is shared
    is a result of its own, which workers hand to each other, computed anew if all of them die. The
    portions that need it are a group of their own: only of a group that needs few results does Dask
    give tasks to any worker, not just to those that have these already.
    """
    if not isinstance(task, Portion):
        return client.submit(tried, work, place, task, pure=False)
    group, common = sent.get(id(task.common), ("", None))
    if common is None or common.status not in {"pending", "finished"}:
        group, pickled = uuid4().hex, pickle.dumps(task.common)
        common = client.submit(bytes, pickled, key=(f"common-{group}", 0))
        sent[id(task.common)] = group, common
    key = (f"portion-{group}", uuid4().hex)
    return client.submit(_tried_portion, work, place, common, task.own, key=key)


def _tried_portion(
    work: Work[Portion[Any, Any], Outcome], place: int, common: bytes, own: object
) -> Result[Outcome]:
    """Result of a portion, for which what it shares is made anew, as all of any other task is."""
    return tried(work, place, Portion(pickle.loads(common), own))  # noqa: S301 - of our own study


def _as_they_come(
    places: dict[Any, int],
    suspects: list[int],
    submit: Callable[[int], None],
    refill: Callable[[], int],
    next_ended: Callable[[], Any],
    result_s: float,
) -> Results[Any]:
    """Results until nothing is left, or no worker; raises `OSError` when no scheduler is there.

    Dask gives up whatever was with a worker that died, some times over. That may be others than
    the one that kills, so all of them are tried again one by one. Of a result that died with its
    worker the news can come before the loss is noticed: it is not waited for, but computed anew.
    """
    gone: Counter[int] = Counter()
    alone: set[int] = set()
    ahead = refill()
    while places or suspects:
        if not places:
            alone.add(suspects[0])
            submit(suspects.pop(0))
        if (future := next_ended()) is None:
            return
        place = places.pop(future)
        result = _result_of(future, place, result_s)
        if future.status == "error" and place not in alone:
            suspects.append(place)
        elif result is not None:
            yield result
        elif gone[place] < ANEW:
            gone[place] += 1
            submit(place)
        else:
            yield Result(place, lost="its result was lost on the cluster again and again")
        if 2 * len(places) <= ahead:
            ahead = refill()


def _threads(client: Any) -> int:
    """Threads of all workers, as the scheduler counts them; raises `OSError`."""
    return sum(client.nthreads().values())


def _next(ended: Queue[Any], empty_s: float, client: Any) -> Any:
    """Future that has ended; None when there are no workers to end any."""
    while True:
        try:
            return ended.get(timeout=empty_s)
        except Empty:
            if not _threads(client):
                return None


def _result_of(future: Any, place: int, within_s: float) -> Result[Any] | None:
    """None when the worker died with the result."""
    if future.status == "cancelled":
        return Result(place, lost="the cluster ended it")
    try:
        result: Result[Any] = future.result(timeout=within_s)
    except TimeoutError:
        return None
    except Exception as error:  # noqa: BLE001 - Dask's own word on this task, told as it is
        return Result(place, lost=f"{type(error).__name__}: {error}".split(". ", maxsplit=1)[0])
    return result
