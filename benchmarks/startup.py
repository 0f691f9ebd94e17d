"""How long a user waits for the program itself: whole processes, from the shell's point of view.

python -m benchmarks.startup [--runs N] [--json]

`pkmcal --help` and `pkmcal identify` on a measured campaign (60 pairs, from shots of the paper's
Table I) by the wall's clock; `--help`, `report`, `devices` and `status` of the same by processor
time, and `identify` by that of a bare import of numpy and scipy.optimize.
`benchmarks.identification` judges the solution itself. Median and least of several runs; the least,
disturbed the least by others on the machine, has to keep the limit. A table has the dearest imports
of each command.
"""

import math
import re
import statistics
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

from benchmarks.shared.measured_robot import SHOTS
from benchmarks.shared.programs import cost_of, pkmcal
from benchmarks.shared.yardstick import Figure, Report, Table, main

LIMITS_S = {"--help": 0.3, "identify": 1.0}
PROCESSOR_LIMITS_S = {"--help": 0.1, "status": 1.0, "devices": 1.0, "report": 1.5}
OVER_BARE = {"standard": 1.5, "auto": 1.9}  # by model, over a bare import's
DEAREST, IMPORT_RUNS = 8, 3
IMPORTED = re.compile(r"import time:\s+(\d+) \|\s+\d+ \|\s*(\S+)")
BARE = (sys.executable, "-c", "import numpy, scipy.optimize")


def measure(runs: int) -> Report:
    with tempfile.TemporaryDirectory() as folder:
        campaign = str(Path(folder) / "campaign")
        pkmcal("new", campaign)
        pkmcal("import", campaign, str(SHOTS))
        identify = partial(pkmcal, "identify", campaign, "--json", expected=(0, 1))  # or undecided
        found = {"--help": [pkmcal("--help")[0] for _ in range(runs)]}
        found["identify"] = [identify()[0] for _ in range(runs)]
        for name in PROCESSOR_LIMITS_S:
            command = partial(pkmcal, *_words(name, campaign))
            found[f"{name}, processor"] = [cost_of(command).seconds for _ in range(runs)]
        bare = partial(subprocess.run, BARE, check=True)
        for model in OVER_BARE:
            run = partial(identify, "--model", model)
            found[model] = [cost_of(run).seconds / cost_of(bare).seconds for _ in range(runs)]
        imports = [
            (name, module, own_s)
            for name in ("--help", "status", "devices", "report", "identify")
            for module, own_s in _dearest_imports(_words(name, campaign))
        ]
    limits = LIMITS_S | {f"{name}, processor": s for name, s in PROCESSOR_LIMITS_S.items()}
    figures = []
    for name, limit in (limits | OVER_BARE).items():
        over = name in OVER_BARE
        told, unit = (f"identify --model {name} over a bare import", "") if over else (name, "s")
        figures.append(Figure(f"{told}, median", statistics.median(found[name]), unit))
        figures.append(Figure(f"{told}, least", min(found[name]), unit, highest=limit))
    return Report(figures, [Table("dearest imports", ("command", "module", "own s"), imports)])


def _words(name: str, campaign: str) -> tuple[str, ...]:
    """A command as it is typed."""
    return (name,) if name.startswith("--") else (name, campaign)


def _dearest_imports(words: tuple[str, ...]) -> list[tuple[str, float]]:
    """Modules that take longest by themselves, and the least time that each took."""
    least_s: dict[str, float] = {}
    command = [sys.executable, "-X", "importtime", "-m", "app", *words]
    subprocess.run(command, capture_output=True, check=False)  # so that all files are at hand
    for _ in range(IMPORT_RUNS):
        told = subprocess.run(command, capture_output=True, text=True, check=False).stderr
        for own_us, module in IMPORTED.findall(told):
            least_s[module] = min(float(own_us) * 1e-6, least_s.get(module, math.inf))
    return sorted(least_s.items(), key=lambda each: each[1], reverse=True)[:DEAREST]


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, runs=9))
