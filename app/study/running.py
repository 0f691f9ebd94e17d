"""Simulation of the campaigns that a study's table lacks, by processes here or a Dask cluster.

Campaigns are independent of each other, so they are handed out in parts: to this process, to local
worker processes, or to the workers of a Dask scheduler. All three are used through an executor of
the standard library's kind, and give the same numbers. A part comes back after five seconds with
what it has, and its other campaigns are handed out once more: a study that is killed keeps all but
the last seconds. An error costs its campaign alone, a local worker that is killed all parts that
had not come back; Dask gives those of its killed workers to others. Lost campaigns are reported,
and a later call computes them, since the table lacks them.
"""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import TypeAlias

from joblib.externals.loky import ProcessPoolExecutor
from joblib.externals.loky.process_executor import TerminatedWorkerError
from rich.console import Console

from app.progress import CountedWork
from app.study.setup import Study
from campaigns.errors import OptionsInvalid, ShotsMissing
from campaigns.studies.study import CampaignRow
from campaigns.studies.summary import StudySummary, summarise
from campaigns.studies.table import StudyTable

CAMPAIGNS_A_PART = 25
"""Most campaigns that are handed out together."""
PART_S = 5.0
"""Time after which a part comes back, s: work that is lost at most if the study is killed."""
KILLED = "a process that computed was killed"

Numbers: TypeAlias = Sequence[int]
"""Numbers of campaigns that one process simulates together."""
Simulate: TypeAlias = Callable[[Numbers], Iterable[CampaignRow]]
Clock: TypeAlias = Callable[[], float]
"""Seconds that never go back."""


@dataclass(frozen=True, slots=True)
class SimulatedPart:
    """Campaigns that were simulated together."""

    rows: tuple[CampaignRow, ...] = ()
    postponed: Numbers = ()
    """Numbers of those for which there was no time."""
    lost: Numbers = ()
    """Numbers of those that have no outcome."""
    reason: str = ""
    """Why they were lost."""


@dataclass(frozen=True, slots=True, eq=False)
class Studied:
    """Campaigns of a study, and the number that were lost."""

    study: Study
    rows: Sequence[CampaignRow]
    computed: int
    """Number of campaigns that were not in the table before."""
    lost: int
    reasons: tuple[str, ...]
    """Why campaigns were lost, each reason once."""

    def summary(self) -> StudySummary:
        """Summarise the campaigns; raise `ShotsMissing` if too few gave an estimate."""
        try:
            return summarise(self.study.parameters, self.rows)
        except ShotsMissing as error:
            if not self.lost:
                raise
            problem = f"{error.problem}, {self.lost} were lost"
            raise ShotsMissing(problem, remedy=f"look into: {'; '.join(self.reasons)}") from error


def run_study(study: Study, table: StudyTable, wanted: range, executor: Executor | None) -> Studied:
    """Simulate the wanted campaigns that a table lacks, and show how many are done.

    Raise `OutputExists` and `WriteFailed`; campaigns that had come back until then are kept.
    """
    # 1. Read the table, and write it at once: that removes a line that was cut off, to which the
    #    next row would be appended, and fails before hours of work if the disk is full.
    # 2. Append each part as it comes back.
    # 3. Write the table again, in the order of numbers.
    table.read()
    missing = [number for number in wanted if number not in table.by_number]
    lost, reasons = 0, dict[str, None]()
    table.write()
    console = Console(stderr=True, highlight=False)
    with CountedWork(console, "campaigns", len(wanted), done=len(wanted) - len(missing)) as counted:
        for part in simulated_parts(study.simulate, missing, executor):
            if part.lost:
                lost += len(part.lost)
                reasons[part.reason] = None
                counted.news = f"{lost} lost"
            table.add(part.rows)
            counted.advance(len(part.rows) + len(part.lost))
    table.write()
    rows = [table.by_number[number] for number in wanted if number in table.by_number]
    return Studied(study, rows, len(missing) - lost, lost, (*reasons,))


def simulated_parts(
    simulate: Simulate, numbers: Numbers, executor: Executor | None, clock: Clock = time.monotonic
) -> Iterator[SimulatedPart]:
    """Yield parts as they come from an executor's processes, or without an executor from this one.

    If a local process is killed, all parts that had not come back are lost.
    """
    while numbers:
        starts = range(0, len(numbers), CAMPAIGNS_A_PART)
        parts = [numbers[start : start + CAMPAIGNS_A_PART] for start in starts]
        postponed: list[int] = []
        come: Iterable[SimulatedPart]
        if executor is None:
            come = (_simulate_part(simulate, part, clock) for part in parts)
        else:
            come = _come_back(executor, simulate, parts, clock)
        for part in come:
            postponed += part.postponed
            yield part
        numbers = postponed


def _come_back(
    executor: Executor, simulate: Simulate, parts: Sequence[Numbers], clock: Clock
) -> Iterator[SimulatedPart]:
    """Yield the parts that an executor's processes simulate, or what was lost with a process."""
    futures: dict[Future[SimulatedPart], Numbers] = {}
    for numbers in parts:
        try:
            futures[executor.submit(_simulate_part, simulate, numbers, clock)] = numbers
        except BrokenExecutor:  # a process was killed in between
            yield SimulatedPart(lost=numbers, reason=KILLED)
    for future in as_completed(futures):
        # Errors of a simulation come back as a part. One of the future itself means that its
        # process, or the way to it, is gone.
        error = future.exception()
        if error is None:
            yield future.result()
        else:
            is_killed = isinstance(error, TerminatedWorkerError)
            why = KILLED if is_killed else f"{type(error).__name__}: {error}"
            yield SimulatedPart(lost=futures[future], reason=why)


@contextmanager
def local_processes(processes: int) -> Iterator[Executor | None]:
    """Give an executor of so many processes of this computer; None for a single one."""
    if processes == 1:
        yield None
        return
    executor = ProcessPoolExecutor(processes, initializer=_serve, initargs=(os.getpid(),))
    try:
        yield executor
    finally:
        executor.shutdown(wait=True, kill_workers=True)


@contextmanager
def cluster(scheduler: str) -> Iterator[Executor]:
    """Give the executor of the Dask scheduler at this URL.

    Raise `OptionsInvalid` without Dask's `distributed` or when no scheduler answers.
    """
    try:  # an extra that few install
        client = import_module("distributed").Client(scheduler)
    except ImportError:
        remedy = "pip install 'pkmcal[cluster]'"
        raise OptionsInvalid("--scheduler needs Dask", remedy=remedy) from None
    except (OSError, ValueError) as error:
        problem = f"--scheduler {scheduler}: no Dask scheduler answers: {error}"
        remedy = "start one with `dask scheduler`, its workers with `dask worker URL`"
        raise OptionsInvalid(problem, remedy=remedy) from error
    with client:
        yield client.get_executor()


def _simulate_part(simulate: Simulate, numbers: Numbers, clock: Clock) -> SimulatedPart:
    """Simulate campaigns in the worker, at least one; an error there costs its campaign alone."""
    rows: list[CampaignRow] = []
    until_s = clock() + PART_S
    try:
        for row in simulate(numbers):
            rows.append(row)
            if clock() >= until_s:
                break
    except Exception as error:  # noqa: BLE001 - it is reported, and can be computed again
        done = len(rows)
        why = f"{type(error).__name__}: {error}"
        return SimulatedPart((*rows,), numbers[done + 1 :], numbers[done : done + 1], why)
    return SimulatedPart((*rows,), numbers[len(rows) :])


def _serve(parent: int) -> None:
    """Prepare a worker: ignore Ctrl-C, which the first process acts on, and end with that process.

    Workers of a process that was killed would wait for ever to hand over their results.
    """
    # A terminal sends Ctrl-C to all processes of the group. The first one shuts the workers down.
    # A killed parent can send nothing, so each worker watches whether it still has the same one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process as soon as its parent is another one."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)
