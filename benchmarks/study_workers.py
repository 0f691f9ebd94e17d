"""How much faster several workers are than one, on a study of 60 pairs by distances.

python -m benchmarks.study_workers [--campaigns N] [--workers N] [--rounds N] [--json]

Here time is the clock's on the wall. Each round: one worker in this process, then the workers as
`pkmcal study --workers N` starts them, then as many processes that know nothing of each other and
share the same work evenly. The last say what this machine's cores give at the moment: two cores of
one processor, or with others on them, do less than twice as much as one. Exit code 1 when the
workers, once they run, reach less than 0.9 of it. Their start is given apart.
"""

import multiprocessing
import time
from collections.abc import Mapping, Sequence
from multiprocessing.synchronize import Barrier

from app.study.workers import local_results
from benchmarks.shared.rounds import medians
from benchmarks.shared.studies import tasks_of
from benchmarks.shared.yardstick import Figure, Report, main
from campaigns.estimation.estimators import Estimator
from campaigns.studies.engine import run_task
from campaigns.studies.study import StudyTask

LEAST_OF_THE_MACHINE = 0.9
START_S = 60.0
"""For processes to be ready."""
RUNNING = "once each has come back with a first result"
WITH_START = "their start included"
MACHINE = "processes that know nothing of each other, without their start"
FIRST_RESULTS = "first results after"


def measure(campaigns: int, workers: int, rounds: int) -> Report:
    tasks = tasks_of(Estimator.DISTANCES, 60, campaigns)
    found = medians([one_round(tasks, workers) for _ in range(rounds)])
    least = {RUNNING: asked(found, workers)}
    return Report(
        [
            Figure(
                f"{workers} workers: {name}",
                value,
                "s" if name == FIRST_RESULTS else "× one worker",
                lowest=least.get(name, float("-inf")),
            )
            for name, value in found.items()
        ]
    )


def asked(found: Mapping[str, float], workers: int) -> float:
    """The least that is good enough for workers once they run."""
    return LEAST_OF_THE_MACHINE * min(found[MACHINE], float(workers))


def one_round(tasks: Sequence[StudyTask], workers: int) -> dict[str, float]:
    alone_s = arrivals_s(tasks, 1)[-1]
    arrivals = arrivals_s(tasks, workers)
    start_s, last_s = arrivals[workers - 1], arrivals[-1]
    running_s = (last_s - start_s) * len(tasks) / (len(tasks) - workers)
    return {
        RUNNING: alone_s / running_s,
        WITH_START: alone_s / last_s,
        MACHINE: alone_s / unconnected_s(tasks, workers),
        FIRST_RESULTS: start_s,
    }


def arrivals_s(tasks: Sequence[StudyTask], workers: int) -> list[float]:
    """When each task's result came, seconds from the beginning."""
    began_s = time.perf_counter()
    return [time.perf_counter() - began_s for _ in local_results(tasks, workers, run_task)]


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
    raise SystemExit(main(__doc__, measure, campaigns=1000, workers=2, rounds=3))
