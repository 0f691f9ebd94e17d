"""What a whole calibration gains, on several simulated robots and measurements of each scenario.

python -m benchmarks.dry_runs [--seeds N] [--json]

Every seed is a dry run of its own, through drivers, protocols and sockets: 60 pairs to identify
from, 20 unseen ones, validation before and after. Given per seed and as the median, which has to
keep the limits.
"""

import json
import math
import tempfile
from functools import reduce
from operator import getitem
from pathlib import Path

from benchmarks.shared.programs import pkmcal
from benchmarks.shared.rounds import medians
from benchmarks.shared.yardstick import Figure, Report, Table, main

PLACES = {
    "distances: mean": ("distances_mm", "mean_abs"),
    "distances: max": ("distances_mm", "max_abs"),
    "rotation": ("rotation_mm",),
    "straightness x": ("straightness_mm", "x"),
    "straightness y": ("straightness_mm", "y"),
    "straightness z": ("straightness_mm", "z"),
    "repeatability radius": ("repeatability", "radius_mm"),
    "frame: max": ("frame_mm", "max"),
}
"""Where each figure stands in the document of a dry run, under `before` and `after`; all in mm."""
SECONDS = "seconds"
LIMITS = {
    "paper-simulation": {
        "distances: max, before": (4.0, math.inf),
        "distances: mean, after": (0.0, 0.016),
        "distances: max, after": (0.0, 0.05),
        SECONDS: (0.0, 60.0),
    },
    "paper-prototype": {
        "distances: mean, after": (0.0, 0.3),
        "distances: max, after": (0.0, 1.0),
        "repeatability radius, after": (0.3, 0.5),
        SECONDS: (0.0, 60.0),
    },
}
"""Scenarios, with the lowest and highest of each median that is asked for."""


def measure(seeds: int) -> Report:
    tables: list[Table] = []
    judged: list[Figure] = []
    for scenario, limits in LIMITS.items():
        by_seed = {f"seed {seed}": dry_run(scenario, seed) for seed in range(1, seeds + 1)}
        by_seed["median"] = middle = medians(list(by_seed.values()))
        rows: list[list[str | float]] = [
            [name, *(each[name] for each in by_seed.values())] for name in middle
        ]
        tables.append(Table(f"{scenario} (mm, s)", ("", *by_seed), rows))
        for name, (lowest, highest) in limits.items():
            unit = "s" if name == SECONDS else "mm"
            judged.append(Figure(f"{scenario}: {name}", middle[name], unit, lowest, highest))
    return Report(judged, tables)


def dry_run(scenario: str, seed: int) -> dict[str, float]:
    """The figures of one dry run."""
    with tempfile.TemporaryDirectory() as folder:
        words = ("dry-run", str(Path(folder) / "campaign"), "--scenario", scenario)
        seconds, answer = pkmcal(*words, "--seed", str(seed), "--json")
    document = json.loads(answer)
    figures = {
        f"{name}, {when}": float(reduce(getitem, (when, *place), document))
        for name, place in PLACES.items()
        for when in ("before", "after")
    }
    return figures | {SECONDS: seconds}


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, seeds=3))
