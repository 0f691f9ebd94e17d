"""How much faster several workers are than one, on a study of 60 pairs by distances.

python -m benchmarks.study_workers [--campaigns N] [--workers N] [--rounds N] [--json]

Here time is the clock's on the wall. Each round: one worker in this process, then the workers as
`pkmcal study --workers N` starts them, then as many processes that know nothing of each other and
share the same work evenly. The last say what this machine's cores give at the moment: two cores of
one processor, or with others on them, do less than twice as much as one. Exit code 1 when the
workers, once they run, reach less than 0.9 of it. Their start is given apart.
"""

import argparse
import json
import multiprocessing
import os
import statistics
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from multiprocessing.synchronize import Barrier

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")
# before NumPy is imported, here and in the workers: one core each, as the program itself keeps to

from app.study.workers import local_results
from benchmarks.shared.studies import tasks_of
from campaigns.estimation.estimators import Estimator
from campaigns.studies.study import StudyTask, run_task

LEAST_OF_THE_MACHINE = 0.9
START_S = 60.0
"""For processes to be ready."""


@dataclass(frozen=True, slots=True)
class Gains:
    """How many times as fast as one worker; a round's, or medians."""

    running: float
    """Of the workers, from when each has come back with a first result."""
    with_start: float
    """Of the workers, their start included."""
    machine: float
    """Of processes that know nothing of each other, without their start."""
    start_s: float
    """Until then."""

    def asked(self, workers: int) -> float:
        """The least that is good enough for `running`."""
        return LEAST_OF_THE_MACHINE * min(self.machine, float(workers))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--campaigns", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    tasks = tasks_of(Estimator.DISTANCES, 60, asked.campaigns)
    gains = medians([one_round(tasks, asked.workers) for _ in range(asked.rounds)])
    least = gains.asked(asked.workers)
    if asked.json:
        print(json.dumps({"workers": asked.workers, "least": least, **asdict(gains)}))
    else:
        show(gains, asked.workers, asked.campaigns, least)
    return int(gains.running < least)


def show(gains: Gains, workers: int, campaigns: int, least: float) -> None:
    print(f"{workers} workers against one, {campaigns} campaigns")
    print(f"  once they run          {gains.running:5.2f} times as fast, at least {least:.2f}")
    print(
        f"  their start included   {gains.with_start:5.2f}, first results in {gains.start_s:.1f} s"
    )
    print(f"  unconnected processes  {gains.machine:5.2f}, what this machine gives now")


def medians(rounds: Sequence[Gains]) -> Gains:
    by_figure = zip(*(asdict(each).values() for each in rounds), strict=True)
    return Gains(*(statistics.median(values) for values in by_figure))


def one_round(tasks: Sequence[StudyTask], workers: int) -> Gains:
    alone_s = arrivals_s(tasks, 1)[-1]
    arrivals = arrivals_s(tasks, workers)
    start_s, last_s = arrivals[workers - 1], arrivals[-1]
    running_s = (last_s - start_s) * len(tasks) / (len(tasks) - workers)
    return Gains(
        alone_s / running_s, alone_s / last_s, alone_s / unconnected_s(tasks, workers), start_s
    )


def arrivals_s(tasks: Sequence[StudyTask], workers: int) -> list[float]:
    """When each task's result came, seconds from the beginning."""
    began_s = time.perf_counter()
    return [time.perf_counter() - began_s for _ in local_results(tasks, workers)]


def unconnected_s(tasks: Sequence[StudyTask], processes: int) -> float:
    """How long processes take that share the tasks, from when all are ready."""
    spawning = multiprocessing.get_context("spawn")
    together = spawning.Barrier(processes + 1)
    shares = [tasks[first::processes] for first in range(processes)]
    started = [
        spawning.Process(target=do_share, args=(share, together), daemon=True) for share in shares
    ]
    for process in started:
        process.start()
    together.wait(START_S)
    began_s = time.perf_counter()
    for process in started:
        process.join()
    return time.perf_counter() - began_s


def do_share(tasks: Sequence[StudyTask], together: Barrier) -> None:
    together.wait(START_S)
    for task in tasks:
        run_task(task)


if __name__ == "__main__":
    sys.exit(main())
