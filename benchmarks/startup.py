"""How long a user waits for the program itself: whole processes, from the shell's point of view.

python -m benchmarks.startup [--runs N] [--json]

`pkmcal --help` and `pkmcal identify` on a measured campaign (60 pairs, from shots of the paper's
Table I) by the wall's clock; `--help`, `report`, `devices` and `status`, asked a second time, of
the same by processor time, and `identify` by that of a bare import of numpy and scipy.optimize.
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
from collections.abc import Callable
from functools import partial
from pathlib import Path

from benchmarks.shared.measured_robot import SHOTS
from benchmarks.shared.programs import cost_of, pkmcal
from benchmarks.shared.yardstick import Figure, Report, Table, main

LIMITS_S = {"--help": 0.3, "identify": 1.0}
PROCESSOR_LIMITS_S = {"--help": 0.1, "status": 0.3, "devices": 0.4, "report": 1.5}
DEAREST, IMPORT_RUNS = 8, 3
IMPORTED = re.compile(r"import time:\s+(\d+) \|\s+\d+ \|\s*(\S+)")
BARE = (sys.executable, "-c", "import numpy, scipy.optimize")
OVER_BARE = {"standard": 1.5, "auto": 1.9}
"""Most of an identification's processor time by model, over that of a bare import."""
UNDECIDED = 1
"""Exit code: computed, but not decided."""


def measure(runs: int) -> Report:
    with tempfile.TemporaryDirectory() as folder:
        campaign = str(Path(folder) / "campaign")
        pkmcal("new", campaign)
        pkmcal("import", campaign, str(SHOTS))
        words, expected = ("identify", campaign, "--json"), (0, UNDECIDED)
        identified_s = [pkmcal(*words, expected=expected)[0] for _ in range(runs)]
        pkmcal("status", campaign)
        spent_s = {
            name: [cost_of(partial(pkmcal, *_words(name, campaign))).seconds for _ in range(runs)]
            for name in PROCESSOR_LIMITS_S
        }
        commands: dict[str, Callable[[], object]] = {
            model: partial(pkmcal, *words, "--model", model, expected=expected)
            for model in OVER_BARE
        }
        commands["bare"] = partial(subprocess.run, BARE, check=True)
        rounds = [
            {name: cost_of(run).seconds for name, run in commands.items()} for _ in range(runs)
        ]
        imports = [
            (name, module, own_s)
            for name in (*PROCESSOR_LIMITS_S, "identify")
            for module, own_s in _dearest_imports(_words(name, campaign))
        ]
    helped_s = [pkmcal("--help")[0] for _ in range(runs)]
    times_s = (helped_s, identified_s)
    limits = [*LIMITS_S.items(), *((f"{n}, processor", s) for n, s in PROCESSOR_LIMITS_S.items())]
    found = [(*each, "s") for each in zip(limits, (*times_s, *spent_s.values()), strict=True)]
    for model, limit in OVER_BARE.items():
        ratios = [each[model] / each["bare"] for each in rounds]
        found.append(((f"identify --model {model} over a bare import", limit), ratios, ""))
    figures = []
    for (name, limit), values, unit in found:
        figures.append(Figure(f"{name}, median", statistics.median(values), unit))
        figures.append(Figure(f"{name}, least", min(values), unit, highest=limit))
    heads = ("command", "module", "s, its own alone")
    return Report(figures, [Table("dearest imports", heads, imports)])


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
