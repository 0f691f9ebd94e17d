"""Tasks on an existing Dask cluster, whose workers have pkmcal installed too."""

import asyncio
import importlib
import logging
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from queue import Empty, Queue
from typing import Any, Generic

from app.study.results import Lost, Outcome, Result, Results, Task, Work, tried
from campaigns.errors import OptionsInvalid

LOGS = ("distributed", "distributed.client", "asyncio")
"""Of the client; each has a level of its own."""
ANEW = 3
"""How often a task is given to the cluster anew when its result has gone."""


@dataclass(frozen=True, slots=True)
class Patience:
    """How long a cluster is waited for, in seconds."""

    connect_s: float = 5.0
    """For the scheduler to answer, and for a first worker."""
    result_s: float = 10.0
    """To bring a finished result here, or to notice that it is gone."""
    empty_s: float = 60.0
    """For any result, before it is asked whether there are workers at all."""


def cluster_results(
    tasks: Sequence[Task],
    scheduler: str,
    work: Work[Task, Outcome],
    patience: Patience = Patience(),
) -> Results[Outcome]:
    """Results from the cluster of a scheduler, which is asked only if there is something to do.

    Raises `OptionsInvalid` at once when Dask is not installed or no scheduler or worker answers.
    """
    if not tasks:
        return _nothing()
    try:
        distributed = importlib.import_module("distributed")
    except ImportError as error:
        raise OptionsInvalid(
            "--workers names a scheduler, but Dask is not installed",
            remedy="install pkmcal[cluster], or give a number of local processes",
        ) from error
    for name in LOGS:  # what matters of it becomes our words
        logging.getLogger(name).setLevel(logging.CRITICAL)
    _check_answers(distributed, scheduler, patience.connect_s)
    client = distributed.Client(scheduler, timeout=patience.connect_s, set_as_default=False)
    _check_workers(client, scheduler, patience.connect_s)
    return _from_cluster(client, tasks, work, patience)


def _nothing() -> Results[Outcome]:
    yield from ()


def _check_answers(distributed: Any, scheduler: str, within_s: float) -> None:
    """Ask before there is a client, which after a failure would need as long again to clean up.

    Raises `OptionsInvalid`.
    """

    async def ask() -> None:
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


def _check_workers(client: Any, scheduler: str, within_s: float) -> None:
    """Raise `OptionsInvalid` for a cluster in which nobody would do the work."""
    try:
        client.wait_for_workers(1, timeout=within_s)
    except TimeoutError as error:
        client.close()
        raise OptionsInvalid(
            f"the Dask scheduler at {scheduler} has no workers",
            remedy=f"start some: dask worker {scheduler}, or give a number of local processes",
        ) from error


def _from_cluster(
    client: Any, tasks: Sequence[Task], work: Work[Task, Outcome], patience: Patience
) -> Results[Outcome]:
    """Dask gives up whatever was with a worker that died, some times over.

    That may be others than the one that kills, so all of them are tried again one by one.
    """
    with client:
        cluster = _Cluster(client, tasks, work, patience)
        suspects = []
        for result in cluster.results(range(len(tasks))):
            if isinstance(result, _GivenUp):
                suspects.append(result.place)
            else:
                yield result
        for place in suspects:
            for result in cluster.results([place]):
                yield Lost(place, result.reason) if isinstance(result, _GivenUp) else result


@dataclass(frozen=True, slots=True)
class _GivenUp:
    """A task that the cluster itself has ended, and its word on it."""

    place: int
    reason: str


class _Cluster(Generic[Task, Outcome]):
    """Gives tasks to a cluster and takes their results as they come."""

    def __init__(
        self,
        client: Any,
        tasks: Sequence[Task],
        work: Work[Task, Outcome],
        patience: Patience,
    ) -> None:
        self._client = client
        self._tasks = tasks
        self._work = work
        self._patience = patience
        self._places: dict[Any, int] = {}
        self._ended: Queue[Any] = Queue()
        self._gone: Counter[int] = Counter()

    def results(self, places: Iterable[int]) -> Iterator[Result[Outcome] | _GivenUp]:
        """Of the tasks at these places."""
        for place in places:
            self._submit(place)
        while self._places:
            try:
                future = self._ended.get(timeout=self._patience.empty_s)
            except Empty:
                if not self._client.nthreads():
                    yield from self._deserted()
                continue
            place = self._places.pop(future)  # and with the future what the cluster keeps of it
            result: Result[Outcome] | _GivenUp | None
            result = _result_of(future, place, self._patience.result_s)
            if result is not None:
                yield result
            elif self._gone[place] < ANEW:
                self._gone[place] += 1
                self._submit(place)
            else:
                yield Lost(place, "its result was lost on the cluster again and again")

    def _submit(self, place: int) -> None:
        task = self._tasks[place]
        future = self._client.submit(tried, self._work, place, task, pure=False)
        self._places[future] = place
        future.add_done_callback(self._ended.put)

    def _deserted(self) -> Iterator[Lost]:
        yield from (
            Lost(place, "the cluster has no workers left") for place in self._places.values()
        )
        self._places.clear()


def _result_of(future: Any, place: int, within_s: float) -> Result[Outcome] | _GivenUp | None:
    """None when the worker died with the result.

    Dask would compute that again, but whoever waits for it may wait for ever: the news of it can
    come before the loss is noticed.
    """
    if future.status == "cancelled":
        return Lost(place, "the cluster ended it")
    try:
        result: Result[Outcome] = future.result(timeout=within_s)
    except TimeoutError:
        return None
    except Exception as error:  # noqa: BLE001 - Dask's own word on this task, told as it is
        return _GivenUp(place, f"{type(error).__name__}: {error}".split(". ", maxsplit=1)[0])
    return result
