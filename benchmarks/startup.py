"""How long a user waits for the program itself: whole processes, from the shell's point of view.

python -m benchmarks.startup [--runs N] [--json]

`pkmcal --help` and `pkmcal identify` on a measured campaign (60 pairs, from shots of the paper's
Table I), and identify's own solution inside it, by the wall's clock; `pkmcal report` of the same by
processor time. Median and least of several runs; the least, disturbed the least by others on the
machine, has to keep the limit.
"""

import json
import resource
import statistics
import tempfile
from pathlib import Path

from benchmarks.shared.programs import pkmcal
from benchmarks.shared.yardstick import Figure, Report, main

SHOTS = Path(__file__).parents[1] / "tests" / "data" / "vectors" / "table1-tracker-noise.csv"
LIMITS_S = {"--help": 0.3, "identify": 1.0, "solution within identify": 0.01, "report": 1.5}
UNDECIDED = 1
"""Exit code: computed, but not decided."""


def measure(runs: int) -> Report:
    with tempfile.TemporaryDirectory() as folder:
        campaign = str(Path(folder) / "campaign")
        pkmcal("new", campaign)
        pkmcal("import", campaign, str(SHOTS))
        words, expected = ("identify", campaign, "--json"), (0, UNDECIDED)
        answers = [pkmcal(*words, expected=expected) for _ in range(runs)]
        drawn_s = [_processor_s("report", campaign) for _ in range(runs)]
    helped_s = [pkmcal("--help")[0] for _ in range(runs)]
    solved_s = [json.loads(answer)["seconds"] for _, answer in answers]
    times_s = (helped_s, [seconds for seconds, _ in answers], solved_s, drawn_s)
    figures = []
    for (name, limit), runs_s in zip(LIMITS_S.items(), times_s, strict=True):
        figures.append(Figure(f"{name}, median", statistics.median(runs_s), "s"))
        figures.append(Figure(f"{name}, least", min(runs_s), "s", highest=limit))
    return Report(figures)


def _processor_s(*words: str) -> float:
    """Processor time of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    pkmcal(*words)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, runs=9))
