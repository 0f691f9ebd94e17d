"""Who computes a study, and what is lost when one of them dies."""

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from poisoned_work import POISON, harmless

from app.errors import UsageInvalid
from app.study.running import workers_of
from app.study.workers import Lost, cluster_results, local_results
from campaigns.study import StudyTask

HERE = Path(__file__).parent
REPOSITORY = HERE.parents[2]


def tasks(count=4):
    return [StudyTask(None, (n, n + 1), np.empty((2, 29))) for n in range(0, 2 * count, 2)]


def numbers(results):
    return [outcome.number for outcomes in results for outcome in outcomes]


def told_with_poison(workers):
    path = os.pathsep.join([str(REPOSITORY), str(HERE)])
    ended = subprocess.run(
        [sys.executable, str(HERE / "lose_a_worker.py"), workers],
        capture_output=True,
        text=True,
        timeout=60,
        env=os.environ | {"PYTHONPATH": path},
    )
    assert ended.returncode == 0, ended.stderr
    return json.loads(ended.stdout)


def test_one_worker_works_in_this_process():
    assert numbers(local_results(tasks(), 1, harmless)) == list(range(8))


def test_killed_process_costs_only_its_own_task():
    told = told_with_poison("local")
    assert told["lost"] == [POISON - 1, POISON]
    assert told["back"] == [n for n in range(40) if n not in told["lost"]]


@pytest.mark.skipif(find_spec("distributed") is None, reason="pkmcal[cluster] is not installed")
def test_killed_worker_of_a_cluster_costs_only_its_own_task():
    told = told_with_poison("cluster")
    assert told["lost"] == [POISON - 1, POISON]
    assert told["back"] == [n for n in range(40) if n not in told["lost"]]


@pytest.mark.parametrize("text", ["", "0", "-1", "two", "1.5", "http://here", "٣"])
def test_workers_that_are_neither_number_nor_scheduler_are_refused(text):
    with pytest.raises(UsageInvalid, match="--workers is"):
        workers_of(text)


def test_cluster_without_dask_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageInvalid, match=r"pkmcal\[cluster\]"):
        workers_of("tcp://127.0.0.1:8786")(tasks())


class FakeClient:
    """A cluster on which futures end as a script says, from the last task to the first."""

    loop = None

    def __init__(self, address, **options):
        if address != "tcp://there:8786":
            raise OSError("timed out")
        self.closed = False

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.closed = True

    def submit(self, work, task, pure):
        assert not pure, "Dask would take equal tasks for one"
        if task.numbers[0] == 2:
            return Future("error", error=ValueError("out of luck"))
        if task.numbers[0] == 4:
            return Future("lost", result=work(task))
        return Future("finished", result=work(task))


class Future(SimpleNamespace):
    """Hashed by identity, as Dask's are by key."""

    __hash__ = object.__hash__

    def __init__(self, status, result=None, error=None):
        super().__init__(status=status, result=lambda: result, exception=lambda: error)


class Completed:
    """Comes back with what was lost once it has been computed again."""

    def __init__(self, futures, loop):
        self._futures = futures

    def add(self, future):
        future.status = "finished"
        self._futures.insert(0, future)

    def __iter__(self):
        while self._futures:
            yield self._futures.pop()


@pytest.fixture
def fake_dask(monkeypatch):
    fake = SimpleNamespace(Client=FakeClient, as_completed=Completed)
    monkeypatch.setitem(sys.modules, "distributed", fake)


@pytest.mark.usefixtures("fake_dask")
def test_failed_task_of_a_cluster_is_lost_alone():
    *others, failed = sorted(
        cluster_results(tasks(), "tcp://there:8786", harmless), key=lambda r: isinstance(r, Lost)
    )
    assert failed == Lost((2, 3), "ValueError: out of luck")
    assert sorted(numbers(others)) == [0, 1, 4, 5, 6, 7]


@pytest.mark.usefixtures("fake_dask")
def test_scheduler_that_is_not_there_is_said_before_anything_begins():
    with pytest.raises(UsageInvalid, match="no Dask scheduler answers at tcp://elsewhere:1"):
        cluster_results(tasks(), "tcp://elsewhere:1", harmless)
