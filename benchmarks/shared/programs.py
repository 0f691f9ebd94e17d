"""The program itself, as a shell starts it, and what works cost in processes of their own."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path

PKMCAL = str(Path(sys.executable).with_name("pkmcal"))
KB_PER_MB = 1024.0


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of a work: processor time, and the largest resident memory."""

    seconds: float
    memory_mb: float


def pkmcal(*words: str, expected: Collection[int] = (0,)) -> tuple[float, str]:
    """Run a command; gives the seconds it took by the wall's clock, and its answer."""
    began_s = time.perf_counter()
    done = subprocess.run([PKMCAL, *words], capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - began_s
    if done.returncode not in expected:
        raise SystemExit(f"pkmcal {' '.join(words)}: exit code {done.returncode}\n{done.stderr}")
    return seconds, done.stdout


def cost_of(work: Callable[[], object]) -> Cost:
    """Cost of a work in a process of its own, and of those that it starts."""
    if (child := os.fork()) == 0:
        try:
            work()
        except BaseException as error:  # noqa: BLE001 - whatever it was, the parent ends with it
            print(error, file=sys.stderr, flush=True)
            os._exit(1)
        os._exit(0)
    _, status, spent = os.wait4(child, 0)
    if status:
        raise SystemExit(f"the work failed: exit code {os.waitstatus_to_exitcode(status)}")
    return Cost(spent.ru_utime + spent.ru_stime, spent.ru_maxrss / KB_PER_MB)
