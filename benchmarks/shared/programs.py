"""The program itself, as a shell starts it."""

import subprocess
import sys
import time
from collections.abc import Collection
from pathlib import Path

PKMCAL = str(Path(sys.executable).with_name("pkmcal"))


def pkmcal(*words: str, expected: Collection[int] = (0,)) -> tuple[float, str]:
    """Run a command; gives the seconds it took by the wall's clock, and its answer."""
    began_s = time.perf_counter()
    done = subprocess.run([PKMCAL, *words], capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - began_s
    if done.returncode not in expected:
        raise SystemExit(f"pkmcal {' '.join(words)}: exit code {done.returncode}\n{done.stderr}")
    return seconds, done.stdout
