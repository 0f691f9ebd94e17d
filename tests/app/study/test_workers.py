"""Who computes a study, and what is lost when one of them dies."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from app.study.running import KILLED, Part, simulated_parts

FAULT, POISON = 3, 5
NAME = "plan-paper-simulation"
HERE = Path(__file__).parent
TWO_WORKERS = """
import json
from app.study.running import local_processes
from test_workers import simulated_parts, work
if __name__ == "__main__":
    with local_processes(2) as executor:
        parts = simulated_parts(work, range(20), executor)
        print(json.dumps([(part.numbers, part.lost) for part in parts]))
"""


def work(number):
    if number == FAULT:
        raise ZeroDivisionError("by nothing")
    if number == POISON:
        os.kill(os.getpid(), signal.SIGKILL)
    return (number,)


def test_failed_task_costs_itself_alone_and_says_why():
    results = list(simulated_parts(work, range(5), None))
    assert results[FAULT] == Part(FAULT, lost="ZeroDivisionError: by nothing")
    assert [row for result in results for row in result.rows] == [0, 1, 2, 4]


@pytest.mark.long
def test_killed_worker_costs_what_had_not_come_back():
    """In a process of its own, with which the pool's own processes end."""
    paths = os.pathsep.join([str(HERE.parents[2]), str(HERE)])
    environment = os.environ | {"PYTHONPATH": paths}
    command = (sys.executable, "-c", TWO_WORKERS)
    ended = subprocess.run(command, capture_output=True, text=True, timeout=110, env=environment)
    assert ended.returncode == 0, ended.stderr
    results = dict(json.loads(ended.stdout))
    assert sorted(results) == list(range(20))
    lost = {place: why for place, why in results.items() if why}
    assert lost.pop(FAULT, KILLED) in {KILLED, "ZeroDivisionError: by nothing"}
    assert POISON in lost
    assert {*lost.values()} == {KILLED}


@pytest.fixture
def dask_scheduler(tmp_path):
    """Gives the address of a scheduler with two workers, each of them a process."""
    file = tmp_path / "scheduler.json"
    place = ("--host", "127.0.0.1", "--no-dashboard", "--scheduler-file", str(file))
    scheduler = ("distributed.cli.dask_scheduler", "--port", "0")
    worker = ("distributed.cli.dask_worker", "--nworkers", "2", "--nthreads", "1")
    first, second = (
        subprocess.Popen((sys.executable, "-m", *module, *place)) for module in (scheduler, worker)
    )
    try:
        while not file.exists() or not file.read_text():
            time.sleep(0.05)
        yield json.loads(file.read_text())["address"]
    finally:
        for process in (second, first):
            process.terminate()
            process.wait()


@pytest.mark.long
def test_numbers_are_the_same_whoever_computes_them(planned_once, tmp_path, dask_scheduler):
    command = (sys.executable, "-m", "app.main", "study", str(planned_once), "--campaigns", "30")
    ways = {"alone": "--workers=1", "local": "--workers=2", "far": f"--scheduler={dask_scheduler}"}
    tables = []
    for name, way in ways.items():
        subprocess.run((*command, way, "--to", str(tmp_path / name)), check=True, timeout=110)
        tables.append((tmp_path / name / f"{NAME}.jsonl").read_bytes())
    assert tables[0] == tables[1] == tables[2]


@pytest.mark.long
def test_scheduler_that_does_not_answer_is_named(planned_once):
    options = ("--campaigns", "2", "--scheduler", "tcp://127.0.0.1:9")
    command = (sys.executable, "-m", "app.main", "study", str(planned_once), *options)
    quick = os.environ | {"DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "100ms"}
    ended = subprocess.run(command, capture_output=True, text=True, timeout=110, env=quick)
    assert ended.returncode == 2
    assert "--scheduler tcp://127.0.0.1:9: no Dask scheduler answers" in ended.stderr
