"""What a whole calibration gains, on several simulated robots and measurements of each scenario.

Every seed is a dry run of its own, through drivers, protocols and sockets: 60 pairs to identify
from, 20 unseen ones, validation before and after. Printed per seed and as the median.

    python -m benchmarks.dry_runs [--seeds N] [--scenario NAME]… [--json]
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

SCENARIOS = ("paper-simulation", "paper-prototype")
PKMCAL = (str(Path(sys.executable).with_name("pkmcal")),)
PLACES = {
    "distances before: mean": ("before", "distances_mm", "mean_abs"),
    "distances before: max": ("before", "distances_mm", "max_abs"),
    "distances after: mean": ("after", "distances_mm", "mean_abs"),
    "distances after: max": ("after", "distances_mm", "max_abs"),
    "rotation before": ("before", "rotation_mm"),
    "rotation after": ("after", "rotation_mm"),
    "straightness x before": ("before", "straightness_mm", "x"),
    "straightness x after": ("after", "straightness_mm", "x"),
    "straightness y before": ("before", "straightness_mm", "y"),
    "straightness y after": ("after", "straightness_mm", "y"),
    "straightness z before": ("before", "straightness_mm", "z"),
    "straightness z after": ("after", "straightness_mm", "z"),
    "repeatability radius before": ("before", "repeatability", "radius_mm"),
    "repeatability radius after": ("after", "repeatability", "radius_mm"),
    "frame before: max": ("before", "frame_mm", "max"),
    "frame after: max": ("after", "frame_mm", "max"),
}
"""Where each figure stands in the document of a dry run; all in mm."""
SECONDS = "seconds"
LIMITS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "paper-simulation": {
        "distances before: max": (4.0, float("inf")),
        "distances after: mean": (0.0, 0.016),
        "distances after: max": (0.0, 0.05),
        SECONDS: (0.0, 60.0),
    },
    "paper-prototype": {
        "distances after: mean": (0.0, 0.3),
        "distances after: max": (0.0, 1.0),
        "repeatability radius after": (0.3, 0.5),
        SECONDS: (0.0, 60.0),
    },
}
"""Lowest and highest of each median that is asked for."""


def dry_run(scenario: str, seed: int) -> dict[str, float]:
    """The figures of one dry run."""
    with tempfile.TemporaryDirectory() as folder:
        words = ("dry-run", str(Path(folder) / "campaign"), "--scenario", scenario)
        started_s = time.perf_counter()
        done = subprocess.run(
            [*PKMCAL, *words, "--seed", str(seed), "--json"],
            capture_output=True,
            text=True,
            check=False,
        )
        seconds = time.perf_counter() - started_s
    if done.returncode:
        raise SystemExit(f"{scenario}, seed {seed}: exit code {done.returncode}\n{done.stderr}")
    document = json.loads(done.stdout)
    return {name: figure(document, place) for name, place in PLACES.items()} | {SECONDS: seconds}


def figure(document: object, place: Sequence[str]) -> float:
    """One figure of a document."""
    for key in place:
        assert isinstance(document, dict)
        document = document[key]
    return float(str(document))


def medians(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Of each figure over all seeds."""
    return {name: statistics.median(row[name] for row in rows) for name in rows[0]}


def missed(scenario: str, middle: Mapping[str, float]) -> list[str]:
    """The figures whose median is outside its limits."""
    limits = LIMITS.get(scenario, {})
    return [name for name, (low, high) in limits.items() if not low <= middle[name] <= high]


def shown(scenario: str, by_seed: Mapping[int, Mapping[str, float]]) -> str:
    """A table: a row a figure, a column a seed."""
    middle = medians(list(by_seed.values()))
    lines = [
        f"{scenario} (mm, s)",
        " " * 28 + "".join(f"  seed {s:<3}" for s in by_seed) + "  median",
    ]
    for name, value in middle.items():
        values = "".join(f"{row[name]:10.3f}" for row in by_seed.values())
        limits = LIMITS.get(scenario, {}).get(name)
        asked = f"   asked: {limits[0]:g} to {limits[1]:g}" if limits else ""
        lines.append(f"{name:<28}{values}{value:10.3f}{asked}")
    return "\n".join(lines)


def main(arguments: Sequence[str]) -> int:
    """Print all figures; 1 when a median is outside its limits."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3, metavar="N")
    parser.add_argument("--scenario", action="append", metavar="NAME")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    found = {
        scenario: {seed: dry_run(scenario, seed) for seed in range(1, options.seeds + 1)}
        for scenario in options.scenario or SCENARIOS
    }
    middle = {scenario: medians(list(rows.values())) for scenario, rows in found.items()}
    if options.json:
        print(json.dumps({"seeds": found, "median": middle}))
    else:
        print("\n\n".join(shown(scenario, rows) for scenario, rows in found.items()))
    return int(any(missed(scenario, figures) for scenario, figures in middle.items()))


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
