"""Who computes a study, and what is lost when one of them dies."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from app.main import run_command
from app.study.workers import KILLED, Part, simulated_parts

FAULT, POISON = 3, 5
NAME = "plan-paper-simulation"
HERE = Path(__file__).parent
TWO_WORKERS = """
import json
from test_workers import simulated_parts, work
if __name__ == "__main__":
    print(json.dumps([(each.place, each.lost) for each in simulated_parts(work, range(20), 2)]))
"""


def work(number):
    if number == FAULT:
        raise ZeroDivisionError("by nothing")
    if number == POISON:
        os.kill(os.getpid(), signal.SIGKILL)
    return (number,)


def rows(results):
    return [row for result in results for row in result.rows]


def test_one_worker_works_in_this_process():
    results = list(simulated_parts(work, range(FAULT), 1))
    assert rows(results) == [0, 1, 2]
    assert [result.place for result in results] == [0, 1, 2]


def test_failed_task_costs_itself_alone_and_says_why():
    results = list(simulated_parts(work, range(5), 1))
    assert results[FAULT] == Part(FAULT, lost="ZeroDivisionError: by nothing")
    assert rows(results) == [0, 1, 2, 4]


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


@pytest.mark.long
def test_numbers_are_the_same_whoever_computes_them(planned_once, tmp_path):
    options = ("--campaigns", "60", "--workers")
    assert run_command(["study", str(planned_once), *options, "1", "--to", str(tmp_path)]) == 0
    alone = (tmp_path / f"{NAME}.jsonl").read_bytes()
    command = (sys.executable, "-m", "app.main", "study", str(planned_once), *options, "2")
    subprocess.run((*command, "--to", str(tmp_path / "2")), check=True, timeout=110)
    assert (tmp_path / "2" / f"{NAME}.jsonl").read_bytes() == alone
