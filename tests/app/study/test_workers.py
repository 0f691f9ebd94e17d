"""Who computes a study, and what is lost when one of them dies."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from timed_pipe import HandClock

from app.study.running import KILLED, simulated_parts

FAULT, POISON = 3, 5
NAME = "plan-paper-simulation"
HERE = Path(__file__).parent
TWO_WORKERS = """
import json
from app.study import running
from test_workers import work
running.CAMPAIGNS_A_PART = 1
if __name__ == "__main__":
    with running.local_processes(2) as executor:
        parts = running.simulated_parts(work, range(20), executor)
        print(json.dumps([([*part.rows], [*part.lost], part.reason) for part in parts]))
"""
WITHIN_S = 100.0


def work(numbers):
    for number in numbers:
        if number == FAULT:
            raise ZeroDivisionError("by nothing")
        if number == POISON:
            os.kill(os.getpid(), signal.SIGKILL)
        yield number


def test_failed_campaign_costs_itself_alone_and_says_why():
    parts = list(simulated_parts(work, range(5), None))
    assert [row for part in parts for row in part.rows] == [0, 1, 2, 4]
    lost = [([*part.lost], part.reason) for part in parts if part.lost]
    assert lost == [([FAULT], "ZeroDivisionError: by nothing")]


def test_part_comes_back_after_five_seconds_with_what_it_has():
    clock = HandClock()

    def slow(numbers):
        for number in numbers:
            clock.sleep_s(2.0)
            yield number

    parts = simulated_parts(slow, range(7), None, clock.now_s)
    assert [part.rows for part in parts] == [(0, 1, 2), (3, 4, 5), (6,)]


@pytest.mark.long
def test_killed_worker_costs_what_had_not_come_back():
    """In a process of its own, with which the pool's own processes end."""
    paths = os.pathsep.join([str(HERE.parents[2]), str(HERE.parents[1] / "support"), str(HERE)])
    environment = os.environ | {"PYTHONPATH": paths}
    command = (sys.executable, "-c", TWO_WORKERS)
    ended = subprocess.run(command, capture_output=True, text=True, timeout=110, env=environment)
    assert ended.returncode == 0, ended.stderr
    parts = json.loads(ended.stdout)
    assert sorted(number for rows, lost, _ in parts for number in rows + lost) == list(range(20))
    reasons = {lost[0]: reason for _, lost, reason in parts if lost}
    assert reasons.pop(FAULT, KILLED) in {KILLED, "ZeroDivisionError: by nothing"}
    assert POISON in reasons
    assert {*reasons.values()} == {KILLED}


@pytest.fixture
def dask(tmp_path):
    """Gives the address of a scheduler and its two workers, each of them a process."""
    file = tmp_path / "scheduler.json"
    place = ("--host", "127.0.0.1", "--no-dashboard", "--scheduler-file", str(file))
    scheduler = ("distributed.cli.dask_scheduler", "--port", "0")
    worker = ("distributed.cli.dask_worker", "--no-nanny", "--nthreads", "1")
    begun = [
        subprocess.Popen((sys.executable, "-m", *module, *place))
        for module in (scheduler, worker, worker)
    ]
    try:
        while not file.exists() or not file.read_text():
            time.sleep(0.05)
        yield json.loads(file.read_text())["address"], begun[1:]
    finally:
        for process in reversed(begun):
            process.terminate()
            process.wait()


@pytest.mark.long
def test_numbers_are_the_same_whoever_computes_them(planned_once, tmp_path, dask):
    command = (sys.executable, "-m", "app.main", "study", str(planned_once), "--campaigns", "30")
    ways = {"alone": "--workers=1", "local": "--workers=2", "far": f"--scheduler={dask[0]}"}
    tables = []
    for name, way in ways.items():
        subprocess.run((*command, way, "--to", str(tmp_path / name)), check=True, timeout=110)
        tables.append((tmp_path / name / f"{NAME}.jsonl").read_bytes())
    assert tables[0] == tables[1] == tables[2]


@pytest.mark.long
def test_killed_worker_of_a_cluster_costs_nothing(planned_once, tmp_path, dask):
    (address, workers), many = dask, 80
    table = tmp_path / f"{NAME}.jsonl"
    options = ("--campaigns", str(many), "--scheduler", address, "--to", str(tmp_path))
    command = (sys.executable, "-m", "app.main", "study", str(planned_once), *options)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as study:
        until_s = time.monotonic() + WITHIN_S
        while not table.exists() or len(table.read_bytes().splitlines()) < 2:
            assert time.monotonic() < until_s
            time.sleep(0.01)
        workers[0].kill()
        out, _ = study.communicate(timeout=WITHIN_S)
    assert (study.returncode, "lost" in out) == (0, False)
    rows = [json.loads(line) for line in table.read_text(encoding="utf-8").splitlines()[1:]]
    assert [row["campaign"] for row in rows] == list(range(many))


@pytest.mark.long
def test_scheduler_that_does_not_answer_is_named(planned_once):
    options = ("--campaigns", "2", "--scheduler", "tcp://127.0.0.1:9")
    command = (sys.executable, "-m", "app.main", "study", str(planned_once), *options)
    quick = os.environ | {"DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "100ms"}
    ended = subprocess.run(command, capture_output=True, text=True, timeout=110, env=quick)
    assert ended.returncode == 2
    assert "--scheduler tcp://127.0.0.1:9: no Dask scheduler answers" in ended.stderr
