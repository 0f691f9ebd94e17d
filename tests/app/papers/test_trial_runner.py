"""Trials in other processes: what fails costs only itself, and a stop is a stop."""

import os
import subprocess
import sys
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path

import pytest
from made_up import result
from rich.console import Console

from app.papers.corbel2006.experiments import Trial, trials
from app.papers.corbel2006.progress import SeedProgress
from app.papers.corbel2006.runner import Failure, outcomes
from app.progress import QUIET_S
from campaigns.errors import Interrupted
from drivers.errors import LinkDown

HERE = Path(__file__).parent
REPOSITORY = HERE.parents[2]


def never():
    return False


def work(trial: Trial):
    if trial.seed == 2:
        raise ValueError("a number too many")
    return result(trial.experiment, trial.seed)


def test_every_trial_comes_back_and_a_failed_one_with_its_reason():
    with ThreadPoolExecutor(2) as pool:
        found = dict(outcomes(trials(3), work, pool, never))
    assert set(found) == set(trials(3))
    failed = [outcome for outcome in found.values() if isinstance(outcome, Failure)]
    assert {failure.trial.seed for failure in failed} == {2}
    assert {failure.reason for failure in failed} == {"unforeseen ValueError: a number too many"}


class Stuck(Executor):
    """Takes work and never does it."""

    def submit(self, fn, /, *args, **kwargs):
        return Future()


def test_stop_does_not_wait_for_what_is_under_way():
    with pytest.raises(Interrupted, match="finished seeds are kept"):
        next(outcomes(trials(1), work, Stuck(), lambda: True))


@pytest.mark.parametrize("how", ["stop", "die"])
def test_no_worker_outlives_the_block(how):
    """In a process of its own: the workers' helper process would outlive this test."""
    started_s = time.monotonic()
    ended = subprocess.run(
        [sys.executable, str(HERE / "stopped_workers.py"), how],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=REPOSITORY,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(REPOSITORY), str(HERE)])},
    )
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.split() == {"stop": ["Interrupted", "gone"], "die": ["named", "gone"]}[how]
    assert time.monotonic() - started_s < 30.0, "it was not waited for"


def test_progress_without_a_terminal_is_a_line_now_and_then(capsys):
    times = iter([0.0, 1.0, QUIET_S, QUIET_S + 1.0, QUIET_S + 2.0])
    console = Console(stderr=True, highlight=False)
    seeds = trials(1)
    with SeedProgress(console, 5, done=1, now_s=lambda: next(times)) as progress:
        progress.count(result(seeds[0].experiment, 1))
        progress.count(Failure(seeds[1], str(LinkDown("no answer", remedy="look"))))
        progress.count(result(seeds[2].experiment, 1))
    assert capsys.readouterr().err == "seeds: 3 of 5 · 1 failed\n"
