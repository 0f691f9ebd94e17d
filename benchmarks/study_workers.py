"""What several workers gain, and what a long study on a cluster survives, keeps in memory, feeds.

python -m benchmarks.study_workers [--campaigns N] [--workers N] [--rounds N] [--long N] [--json]

60 pairs by distances, by the clock on the wall: each round one worker in this process, workers as
`pkmcal study --workers N` starts them, and processes that know nothing of each other: what this
machine's cores give. Exit code 1 when workers, once they run, reach less than 0.9 of it.

A long study of 60 pairs by points on a Dask cluster of this computer: SIGKILL ends the scheduler
when a quarter of the campaigns is done, the study at a half, a worker at three fifths; each is
started again. Exit code 1 when one of the first 5000 lines of the table is not that of local
workers, or memory grows. Tasks without work say what one study feeds.
"""

import os
import socket
import sys
import time
from collections.abc import Mapping, Sequence
from hashlib import sha256
from itertools import zip_longest
from pathlib import Path
from subprocess import DEVNULL, Popen
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import psutil
from distributed import Client
from joblib import Parallel, delayed

from app.study.cluster import cluster_results
from app.study.results import Portion
from app.study.workers import local_results
from benchmarks.shared.programs import PKMCAL, pkmcal
from benchmarks.shared.rounds import medians, timed_s
from benchmarks.shared.studies import SCENARIO, lines_of, tasks_of
from benchmarks.shared.yardstick import Figure, Report, Table, main
from campaigns.estimation.estimators import Estimator
from campaigns.studies.engine import ResultTable, run_task
from campaigns.studies.study import CampaignEstimate, CampaignRow, StudyTask

LEAST_OF_THE_MACHINE = 0.9
RUNNING = "once each has come back with a first result"
MACHINE = "processes that know nothing of each other, without their start"
KILLED = {"scheduler": 0.25, "study": 0.5, "worker 1": 0.6}  # after which share of the campaigns
LINE_BYTES = 1564  # of a campaign with 22 parameters, to tell how many are done
ENOUGH, MOST_SLOPE_MB = 50_000, 5.0  # campaigns that fill the scheduler's logs; in 10 000
COMPARED, TIMED, FED, EVERY_S, READY_S = 5000, 200, 10_000, 0.5, 300.0
SLOPE = "MB in 10 000 campaigns"
MB, MILLION, S_AN_HOUR = 1e6, 1e6, 3600.0
Processes = dict[str, "Popen[bytes]"]
Samples = list[tuple[str, float, float]]  # name of a process, campaigns done, resident MB


def measure(campaigns: int, workers: int, rounds: int, long: int) -> Report:
    tasks = tasks_of(Estimator.DISTANCES, 60, campaigns)
    found = medians([one_round(tasks, workers) for _ in range(rounds)])
    least = {RUNNING: asked(found, workers)}
    gained = [
        Figure(f"{workers} workers: {name}", value, "× one worker", least.get(name, -np.inf))
        for name, value in found.items()
    ]
    survived = killed_cluster(long, workers)
    return Report([*gained, *survived.figures], survived.tables)


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
        "their start included": alone_s / last_s,
        MACHINE: alone_s / unconnected_s(tasks, workers),
    }


def arrivals_s(tasks: Sequence[StudyTask], workers: int) -> list[float]:
    """When each task's result came, seconds from the beginning."""
    began_s = time.perf_counter()
    return [time.perf_counter() - began_s for _ in local_results(tasks, workers, run_task)]


def unconnected_s(tasks: Sequence[StudyTask], processes: int) -> float:
    """How long processes take that share the tasks, from when all are ready."""
    shares = [tasks[first::processes] for first in range(processes)]
    with Parallel(n_jobs=processes) as parallel:
        parallel(delayed(do_share)([]) for _ in shares)
        return timed_s(lambda: parallel(map(delayed(do_share), shares)), time.perf_counter)


def do_share(tasks: Sequence[StudyTask]) -> None:
    for task in tasks:
        run_task(task)


def killed_cluster(campaigns: int, workers: int) -> Report:
    """Study on a cluster of which the scheduler, a worker and the study itself are killed."""
    compared = min(COMPARED, campaigns)
    with socket.create_server(("127.0.0.1", 0)) as listening:
        address = f"tcp://127.0.0.1:{listening.getsockname()[1]}"
    os.environ["DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED"] = "False"  # it keeps an hour of stacks
    processes: Processes = {}
    with TemporaryDirectory() as scratch:
        campaign, there, here = (str(Path(scratch) / name) for name in ("c", "there", "here"))
        pkmcal("new", campaign, "--scenario", SCENARIO.name)
        pkmcal("plan", campaign, "--shots", "120")
        study = ("study", campaign, "--campaigns", str(campaigns), "--to", there)
        try:
            for name in ("scheduler", *(f"worker {n + 1}" for n in range(workers)), "study"):
                start(processes, name, address, study)
            samples = disturbed(processes, campaigns, address, study)
            fed_s = feeding_s(address, Path(scratch) / "fed", processes["scheduler"].pid)
        finally:
            for process in processes.values():
                process.kill()
                process.wait()
        pkmcal("study", campaign, "--campaigns", str(compared), "--to", here)
        table, local = (lines_of(str(next(Path(to).glob("*.jsonl")))) for to in (there, here))
    timed = tasks_of(Estimator.POINTS, 60, TIMED)
    campaign_s = timed_s(lambda: do_share(timed)) / TIMED
    digest = sha256("\n".join([*table, ""]).encode()).hexdigest()
    differing = sum(a != b for a, b in zip_longest(table[: 1 + compared], local))
    rows, most_mb = memory_of(samples, campaigns), MOST_SLOPE_MB if campaigns >= ENOUGH else np.inf
    return Report(
        [
            Figure("campaigns", len(table) - 1, lowest=campaigns, highest=campaigns),
            Figure(f"lines that differ, of {compared}", differing, highest=0),
            *(Figure(f"{name}, slope", slope, SLOPE, highest=most_mb) for name, _, slope in rows),
            Figure("processor time of a campaign", 1e3 * campaign_s, "ms"),
            Figure("processor time of feeding a task", 1e3 * fed_s, "ms"),
            Figure("workers that one study feeds", len(timed[0].numbers) * campaign_s / fed_s),
            Figure("a million campaigns", MILLION * campaign_s / S_AN_HOUR, "core hours"),
        ],
        [Table(f"resident memory; table with sha256 {digest}", ("", "largest MB", SLOPE), rows)],
    )


def disturbed(processes: Processes, campaigns: int, address: str, study: Sequence[str]) -> Samples:
    """Memory by campaigns done, of a study during which one process after the other is killed."""
    samples, left = Samples(), dict(KILLED)
    while (code := processes["study"].poll()) is None:
        time.sleep(EVERY_S)
        done = sum(file.stat().st_size for file in Path(study[-1]).glob("*.jsonl")) / LINE_BYTES
        samples += [
            (name, done, psutil.Process(process.pid).memory_info().rss / MB)
            for name, process in processes.items()
            if process.poll() is None
        ]
        name = next(iter(left), "")
        if name and done >= left[name] * campaigns:
            del left[name]
            processes[name].kill()
            ending = [*processes] if name == "scheduler" else [name]  # all others end with that
            for each in ending:
                processes[each].wait(READY_S)
            for each in ending:
                start(processes, each, address, study)
    if code:
        raise SystemExit(f"the study failed: exit code {code}")
    return samples


def start(processes: Processes, name: str, address: str, study: Sequence[str]) -> None:
    """Start a process; the study when all workers are there."""
    if name == "study":
        command: tuple[str, ...] = (PKMCAL, *study, "--workers", address)
        with Client(address, timeout=READY_S) as client:  # type: ignore[no-untyped-call]
            client.wait_for_workers(sum("worker" in each for each in processes), timeout=READY_S)
    else:
        worker = ("worker", address, "--nthreads", "1", "--no-nanny")
        scheduler = ("scheduler", "--port", address.rpartition(":")[2])
        which, *words = scheduler if name == "scheduler" else worker
        words += ["--host", "127.0.0.1", "--no-dashboard"]
        command = (sys.executable, "-m", f"distributed.cli.dask_{which}", *words)
    processes[name] = Popen(command, stdout=DEVNULL, stderr=DEVNULL)


def feeding_s(address: str, file: Path, scheduler: int) -> float:
    """Processor time of a task without work: the study's, or the scheduler's if that is more."""
    made, table = tasks_of(Estimator.POINTS, 60, FED), ResultTable(file, CampaignRow, "fed")
    shared = made[0].setup, SCENARIO
    tasks = [Portion(shared, task.numbers) for task in made]  # as `pkmcal study` gives them
    busy = psutil.Process(), psutil.Process(scheduler)
    for _ in range(2):  # at first modules are imported
        before = [sum(each.cpu_times()[:2]) for each in busy]
        for result in cluster_results(tasks, address, without_work):
            table.add(result.rows)
    spent = [sum(each.cpu_times()[:2]) - s for each, s in zip(busy, before, strict=True)]
    return float(max(spent)) / len(tasks)


def without_work(task: Portion[Any, tuple[int, ...]]) -> tuple[CampaignRow, ...]:
    """Rows as long as real ones."""
    figures = (1.0 / 7.0,) * 22
    found = CampaignEstimate(errors=figures, std=figures, bound=figures)
    return tuple(CampaignRow(number, estimate=found) for number in task.own)


def memory_of(samples: Samples, campaigns: int) -> list[tuple[str, float, float]]:
    """Largest memory of each process, and slope in the last quarter, before all is summed up."""
    rows, done = [], max(done for _, done, _ in samples)
    for name in dict.fromkeys(name for name, *_ in samples):
        own = np.array([rest for each, *rest in samples if each == name])
        late = own[(own[:, 0] > 0.75 * campaigns) & (own[:, 0] < done)]
        slope = 1e4 * np.polyfit(late[:, 0], late[:, 1], 1)[0] if len(late) > 1 else np.nan
        rows.append((name, float(own[:, 1].max()), float(slope)))
    return rows


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, campaigns=1000, workers=2, rounds=3, long=2000))
