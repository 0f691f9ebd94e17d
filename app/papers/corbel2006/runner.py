"""Runs trials in processes of their own: one that fails costs only itself."""

import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import active_children, get_context

from app.papers.corbel2006.experiments import Trial
from app.papers.corbel2006.trials import TrialResult
from campaigns.errors import Interrupted

LOOK_AGAIN_S = 0.2
"""How often the wish to stop is looked at."""


@dataclass(frozen=True, slots=True)
class Failure:
    """A trial that gave no result, and why."""

    trial: Trial
    reason: str


Outcome = TrialResult | Failure
Work = Callable[[Trial], Outcome]
"""Made in a worker process, so it and what it gives are sent there and back."""


def outcomes(
    trials: Sequence[Trial], work: Work, pool: Executor, stop_requested: Callable[[], bool]
) -> Iterator[tuple[Trial, Outcome]]:
    """Every trial with its outcome as it comes; raises `Interrupted` when it was asked to stop."""
    pending = {pool.submit(work, trial): trial for trial in trials}
    while pending:
        done, _ = wait(pending, timeout=LOOK_AGAIN_S, return_when=FIRST_COMPLETED)
        if stop_requested():
            raise Interrupted(
                "stopped by the operator; the results of finished seeds are kept",
                remedy="the same command goes on with the others",
            )
        for future in done:
            trial = pending.pop(future)
            yield trial, _outcome(future, trial)


@contextmanager
def worker_processes(count: int) -> Iterator[Executor]:
    """So many processes; what still works when the block is left by an error is ended.

    Spawned, for a fork would copy locks of threads that it does not copy.
    """
    others = set(active_children())
    context, initializer = get_context("spawn"), _leave_interrupts_to_parent
    with ProcessPoolExecutor(count, mp_context=context, initializer=initializer) as pool:
        try:
            yield pool
        except BaseException:
            for child in set(active_children()) - others:
                child.kill()
            raise


def _leave_interrupts_to_parent() -> None:
    """Ctrl-C reaches every process of the terminal; only the first one shall act on it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _outcome(future: Future[Outcome], trial: Trial) -> Outcome:
    error = future.exception()
    if error is None:
        return future.result()
    if isinstance(error, BrokenProcessPool):
        return Failure(trial, "a worker process died → give the command again")
    return Failure(trial, f"unforeseen {type(error).__name__}: {error}")
