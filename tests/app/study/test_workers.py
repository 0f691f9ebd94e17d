"""Who computes a study, and what is lost when one of them dies."""

import json
import os
import pickle
import socket
import subprocess
import sys
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from lose_a_worker import COUNT
from poisoned_work import FAULT, POISON, harmless, harmless_portion, work

from app.main import run_command
from app.study.cluster import AHEAD, cluster_results
from app.study.results import Portion, Result
from app.study.workers import local_results, workers_of
from campaigns.errors import OptionsInvalid
from campaigns.studies.study import StudyTask

HERE = Path(__file__).parent
REPOSITORY = HERE.parents[2]
TABLE = "plan-paper-simulation-points.jsonl"
HASTY = {"connect_s": 0.2, "empty_s": 0.01}
NOBODY = "tcp://127.0.0.1:1"
COMMON = "common"


def tasks(count=4, first=0):
    return [
        StudyTask(None, (n, n + 1), np.empty((2, 29))) for n in range(first, first + 2 * count, 2)
    ]


def numbers(results):
    return [row.campaign for result in results for row in result.rows]


@pytest.fixture(scope="module")
def ended_with_poison(planned_once, tmp_path_factory):
    """Runs both parts of lose_a_worker.py once for each kind of workers; gives what it says.

    In a process of its own, where a warning is an error and no pgrep is found.
    """

    @cache
    def run(workers):
        tables = tmp_path_factory.mktemp(workers)
        path = os.pathsep.join([str(REPOSITORY), str(HERE)])
        script = (sys.executable, "-W", "error", HERE / "lose_a_worker.py")
        ended = subprocess.run(
            [*script, workers, planned_once, tables],
            capture_output=True,
            text=True,
            timeout=110,
            env=os.environ | {"PYTHONPATH": path, "PATH": ""},
        )
        assert ended.returncode == 0, ended.stderr
        return json.loads(ended.stderr.splitlines()[-1]), (tables / TABLE).read_bytes()

    return run


def test_one_worker_works_in_this_process():
    results = list(local_results(tasks(), 1, harmless))
    assert numbers(results) == list(range(8))
    assert [result.place for result in results] == [0, 1, 2, 3]


def test_failed_task_costs_itself_alone_and_says_why():
    results = list(local_results(tasks(4, first=FAULT - 4), 1, work))
    assert results[2] == Result(2, lost="ZeroDivisionError: by nothing")
    assert numbers(results) == [
        *(FAULT - 4, FAULT - 3, FAULT - 2, FAULT - 1),
        *(FAULT + 2, FAULT + 3),
    ]


@pytest.mark.long
@pytest.mark.parametrize(
    ("workers", "reason"),
    [
        ("local", "the process that computed it was killed"),
        ("cluster", "KilledWorker: Attempted to run task"),
    ],
)
def test_killed_worker_costs_only_its_own_task(ended_with_poison, workers, reason):
    told = ended_with_poison(workers)[0]["told"]
    assert told["lost"] == [POISON - 1, POISON, FAULT, FAULT + 1]
    assert told["back"] == [n for n in range(40) if n not in told["lost"]]
    failed, killed = sorted(told["reasons"], key=lambda each: each.startswith(reason))
    assert failed == "ZeroDivisionError: by nothing"
    assert killed.startswith(reason)


@pytest.mark.long
@pytest.mark.parametrize("workers", ["local", "cluster"])
def test_numbers_are_the_same_whoever_computes_them(
    ended_with_poison, workers, planned_once, tmp_path
):
    options = ("--campaigns", str(COUNT), "--workers", "1", "--to", str(tmp_path))
    assert run_command(["study", str(planned_once), *options]) == 0
    document, table = ended_with_poison(workers)
    assert document["code"] == 0
    assert table == (tmp_path / TABLE).read_bytes()


@pytest.mark.parametrize("text", ["", "0", "-1", "two", "1.5", "http://here", "٣"])
def test_workers_that_are_neither_number_nor_scheduler_are_refused(text):
    with pytest.raises(OptionsInvalid, match="--workers is"):
        workers_of(text)


def test_without_a_word_every_processor_works(monkeypatch):
    monkeypatch.setattr("app.study.workers.cpu_count", lambda: 7)
    assert workers_of(None).keywords == {"processes": 7}


def test_cluster_without_dask_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(OptionsInvalid, match=r"pkmcal\[cluster\]"):
        workers_of("tcp://127.0.0.1:8786")(tasks(), work=harmless)


@pytest.mark.long
@pytest.mark.parametrize("url", [NOBODY, "tcp://127.0.0.1:port", "tcp://", "tls://127.0.0.1:1"])
def test_scheduler_that_is_not_there_is_said_before_anything_begins(url):
    with pytest.raises(OptionsInvalid, match=f"no Dask scheduler answers at {url}"):
        cluster_results(tasks(), url, harmless, **HASTY)


@pytest.mark.long
def test_listener_that_is_no_scheduler_is_not_waited_for():
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(OptionsInvalid, match="no Dask scheduler answers"):
            cluster_results(tasks(), url, harmless, **HASTY)


def test_no_scheduler_is_asked_when_nothing_is_left_to_do():
    assert list(cluster_results([], NOBODY, harmless)) == []


class FakeClient:
    """A cluster on which tasks end as a script says."""

    loop = None

    def __init__(self, ends, workers=1):
        self._ends = ends
        self._workers = workers
        self._gone = False
        self.submitted = 0
        self.sent_bytes = []
        self.closed = False

    def __call__(self, address, **options):
        """As if it was made here."""
        return self

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.close()

    def close(self):
        self.closed = True

    def wait_for_workers(self, count, timeout):
        if self._workers < count:
            raise TimeoutError

    def nthreads(self):
        if self._gone:
            raise OSError("timed out")
        return {f"tcp://worker{n}": 1 for n in range(self._workers)}

    def submit(self, work, *arguments, pure=True, key=None):
        assert key or not pure, "Dask would take equal tasks for one"
        values = [each for each in arguments if not isinstance(each, Future)]
        self.sent_bytes.append(len(pickle.dumps(values)))
        result = work(*(getattr(each, "_result", each) for each in arguments))
        self.submitted += isinstance(result, Result)
        ends = self._ends.setdefault(getattr(result, "place", COMMON), ["finished"])
        end = ends.pop(0) if len(ends) > 1 else ends[0]
        if end == "never":
            self._workers = 0
        self._gone = end == "gone"
        return Future(result, end)


class Future:
    """What becomes of a task this time."""

    def __init__(self, result, end):
        self._result = result
        self._end = end
        self.status = {"cancelled": "cancelled", KILLED: "error"}.get(end, "finished")

    def add_done_callback(self, call):
        if self._end not in {"never", "gone"}:
            call(self)

    def result(self, timeout):
        if isinstance(self._end, Exception):
            raise self._end
        return self._result


async def answer(address, timeout):
    """A connection that is closed again."""

    async def close():
        """Nothing was opened."""

    return SimpleNamespace(close=close)


@pytest.fixture
def pretend(monkeypatch):
    """Puts a client in the place of Dask's."""

    def replace(client):
        fake = SimpleNamespace(
            Client=client,
            Security=lambda: SimpleNamespace(get_connection_args=lambda role: {}),
            comm=SimpleNamespace(connect=answer),
        )
        monkeypatch.setitem(sys.modules, "distributed", fake)

    return replace


@pytest.fixture
def from_cluster(pretend):
    """Results of eight campaigns in four tasks that end as told, by place."""

    def run(**ends):
        client = FakeClient({int(name.removeprefix("task")): list(e) for name, e in ends.items()})
        pretend(client)
        results = list(cluster_results(tasks(), "tcp://there:8786", harmless, **HASTY))
        assert client.closed
        return sorted(results, key=lambda each: each.place)

    return run


KILLED = ValueError("its workers died. Look at their logs.")


def test_tasks_that_a_cluster_does_not_bring_back_are_lost_alone(from_cluster):
    results = from_cluster(task1=[KILLED], task3=["cancelled"])
    assert results[1] == Result(1, lost="ValueError: its workers died")
    assert results[3] == Result(3, lost="the cluster ended it")
    assert numbers([results[0], results[2]]) == [0, 1, 4, 5]


def test_task_that_was_given_up_beside_another_one_is_tried_again_alone(from_cluster):
    results = from_cluster(task1=[KILLED], task2=[KILLED, "finished"])
    assert results[1] == Result(1, lost="ValueError: its workers died")
    assert numbers([results[0], *results[2:]]) == [0, 1, 4, 5, 6, 7]


def test_result_that_went_with_its_worker_is_computed_anew(from_cluster):
    results = from_cluster(task0=[TimeoutError(), "finished"], task2=[TimeoutError()] * 3 + ["f"])
    assert numbers(results) == list(range(8))


def test_result_that_goes_every_time_is_given_up(from_cluster):
    results = from_cluster(task2=[TimeoutError()])
    assert results[2] == Result(2, lost="its result was lost on the cluster again and again")
    assert numbers([*results[:2], results[3]]) == [0, 1, 2, 3, 6, 7]


def test_cluster_whose_workers_have_all_gone_is_not_waited_for(from_cluster):
    results = from_cluster(task3=["never"])
    assert results[3] == Result(3, lost="the cluster has no workers left")
    assert numbers(results[:3]) == [0, 1, 2, 3, 4, 5]


def test_scheduler_that_has_gone_costs_what_was_left(from_cluster):
    results = from_cluster(task3=["gone"])
    assert numbers(results[:1]) == [0, 1]
    assert {each.lost for each in results[1:]} == {"the cluster's scheduler no longer answers"}
    assert [each.place for each in results] == [0, 1, 2, 3]


def test_cluster_is_given_no_more_tasks_than_its_threads_have_use_for(pretend):
    client, many = FakeClient({}, workers=2), tasks(100)
    pretend(client)
    most = 2 * AHEAD
    for done, _ in enumerate(cluster_results(many, "tcp://there:8786", harmless, **HASTY)):
        assert min(done + most // 2, 100) <= client.submitted <= done + most
    assert client.submitted == 100


@pytest.mark.parametrize(("ends", "sent"), [(["finished"], 2), ([KILLED, "finished"], 3)])
def test_what_portions_share_is_sent_once_unless_it_has_gone(pretend, ends, sent):
    client, commons = FakeClient({COMMON: ends}), [(b"one" * 9999,), (b"two" * 9999,)]
    pretend(client)
    portions = [Portion(common, task) for common in commons for task in tasks(20)]
    results = list(cluster_results(portions, "tcp://there:8786", harmless_portion, **HASTY))
    assert numbers(results) == [*range(40), *range(40)]
    assert sum(size > len(commons[0][0]) for size in client.sent_bytes) == sent


def test_cluster_without_workers_is_said_before_anything_begins(pretend):
    client = FakeClient({}, workers=0)
    pretend(client)
    with pytest.raises(
        OptionsInvalid, match="has no workers → start some: dask worker tcp://there"
    ):
        cluster_results(tasks(), "tcp://there:8786", harmless)
    assert client.closed
