"""How long a user waits for the program itself: whole processes, from the shell's point of view.

`pkmcal --help` and `pkmcal identify` on a measured campaign (60 pairs, from shots of the paper's
Table I), and identify's own solution inside it. Median and least of several runs, by the wall's
clock; the least, disturbed the least by others on the machine, has to keep the limit.

    python -m benchmarks.startup [--runs N] [--json]
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

SHOTS = Path(__file__).parents[1] / "tests" / "data" / "vectors" / "table1-tracker-noise.csv"
LIMITS_S = {"help_s": 0.3, "identify_s": 1.0, "solve_s": 0.01}
PKMCAL = (str(Path(sys.executable).with_name("pkmcal")),)


def pkmcal(*arguments: str) -> tuple[float, str]:
    """Run a command; gives the seconds that it took, and its answer."""
    started_s = time.perf_counter()
    done = subprocess.run([*PKMCAL, *arguments], capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - started_s
    if done.returncode not in {0, 1}:  # 1: computed, but not decided
        raise SystemExit(done.stderr)
    return seconds, done.stdout


def measure(runs: int) -> dict[str, list[float]]:
    """Seconds by name, one a run."""
    with tempfile.TemporaryDirectory() as folder:
        campaign = str(Path(folder) / "campaign")
        pkmcal("new", campaign)
        pkmcal("import", campaign, str(SHOTS))
        answers = [pkmcal("identify", campaign, "--json") for _ in range(runs)]
    return {
        "help_s": [pkmcal("--help")[0] for _ in range(runs)],
        "identify_s": [seconds for seconds, _ in answers],
        "solve_s": [json.loads(answer)["seconds"] for _, answer in answers],
    }


def main(arguments: Sequence[str]) -> int:
    """Print the figures beside their limits; 1 when one is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=9, metavar="N")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    measured = measure(options.runs)
    medians = {name: statistics.median(seconds) for name, seconds in measured.items()}
    least = {name: min(seconds) for name, seconds in measured.items()}
    if options.json:
        told = {"runs": options.runs, "median": medians, "least": least, "limit": LIMITS_S}
        print(json.dumps(told))
    else:
        for name, limit in LIMITS_S.items():
            print(
                f"{name:<12} median {medians[name]:.4f} s, least {least[name]:.4f}, limit {limit}"
            )
    return int(any(least[name] > limit for name, limit in LIMITS_S.items()))


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
