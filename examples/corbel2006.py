"""Repeat the simulation and the experiment of the paper on simulated cells.

D. Corbel, O. Company, V. Nabat, P. Maurine, "Geometrical Calibration of the High Speed Robot Par4
Using a Laser Tracker", MMAR 2006. Prints Tables I to IV and the figures that Figs. 7 and 8 show,
ours beside the printed ones. Three experiments, each seed a whole campaign:

    python examples/corbel2006.py [SEEDS]

One seed takes about 40 s; docs/explanation/reproduction.md has the figures of 5 seeds and says why
ours differ. Lengths in mm, angles in deg.
"""

import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np
from ruamel.yaml import YAML

from app.console import Terminal
from app.rehearsal import rehearse
from campaigns.assessment import Evaluation
from campaigns.evaluation.validation import ValidationResult
from campaigns.identification.options import IdentificationOptions
from pkmcal import create_simulated, evaluate, open_campaign
from sim.scenarios.scenario import load_scenario

ROBOT = "par4-prototype"
REPEATABILITY_MM = 0.4 / math.sqrt(3.0)
"""Half-width of the uniform draw on each coordinate, section IV.D."""
SPEED_UP = 10_000.0
"""Of the cell's time, the largest that there is. The figures do not depend on it."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """Shipped scenario, and the repeatability that is added to it, mm; None: the scenario's."""

    scenario: str
    repeatability_mm: float | None = None


SIMULATION = Experiment("paper-simulation")
REPEATABILITY = Experiment("paper-simulation", REPEATABILITY_MM)
PROTOTYPE = Experiment("paper-prototype")


def changed(path: Path, changes: Mapping[str, object]) -> None:
    """Change keys of a YAML file, named like `plan.seed`."""
    yaml = YAML()
    tree = yaml.load(path)
    for name, value in changes.items():
        *sections, key = name.split(".")
        section = tree
        for step in sections:
            section = section[step]
        section[key] = value
    yaml.dump(tree, path)


def measured(experiment: Experiment, seed: int) -> tuple[Evaluation, Mapping[str, float]]:
    """Run the whole chain in a new campaign; give its evaluation and the true parameters.

    The seed draws the pairs that are measured and all noise.
    """
    with TemporaryDirectory() as room:
        folder = Path(room) / "campaign"
        create_simulated(folder, ROBOT, experiment.scenario, seed)
        changed(folder / "cell.yaml", {"speed_up": SPEED_UP})
        if experiment.repeatability_mm is not None:
            repeatability = {"position_mm": experiment.repeatability_mm}
            changed(folder / "cell.yaml", {"robot.repeatability": repeatability})
        changed(folder / "campaign.yaml", {"plan.seed": seed})
        campaign = open_campaign(folder)
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            how = IdentificationOptions(model="paper")
            _, against = rehearse(campaign, Terminal(as_json=False), how)
        if against:
            raise SystemExit(f"{experiment.scenario}, seed {seed}: {'; '.join(against)}")
        evaluation = evaluate(campaign)
        truth = load_scenario(str(folder / "cell.yaml")).robot.true_flat()
        return evaluation, truth


Quantities = dict[str, float]


def quantities(evaluation: Evaluation, truth: Mapping[str, float]) -> Quantities:
    """Figures of one seed by their names in `GROUPS`, and each parameter's error by its name."""
    identification, errors = evaluation.evidence.identification, evaluation.errors
    assert identification is not None
    assert errors is not None
    assert errors.fitted is not None
    assert errors.unseen is not None
    assert errors.fitted.after_mm is not None
    assert errors.unseen.after_mm is not None
    found = identification.value
    deltas = {name: found.parameters[name].delta for name in found.free}
    missed = {name: abs(found.parameters[name].value - truth[name]) for name in found.free}
    lengths = [size for name, size in missed.items() if name.endswith("_mm")]
    angles = [size for name, size in missed.items() if name.endswith("_deg")]
    return {
        "fitted pairs, before": float(np.abs(errors.fitted.before_mm).max()),
        "fitted pairs, after": float(np.abs(errors.fitted.after_mm).max()),
        "unseen pairs, after": float(np.abs(errors.unseen.after_mm).max()),
        "worst of 18 lengths": max(lengths),
        "middle one of 18 lengths": median(lengths),
        "worst of 4 angles": max(angles),
        "middle one of 4 angles": median(angles),
        **dict(validated(evaluation.before, "before")),
        **dict(validated(evaluation.after, "after")),
        **deltas,
    }


def validated(result: ValidationResult | None, stage: str) -> Iterator[tuple[str, float]]:
    """Figures of the tests of section IV.E before or after calibration."""
    assert result is not None
    assert result.distances is not None
    assert result.rotation is not None
    assert result.repeatability is not None
    errors_mm = np.abs(result.distances.errors_mm)
    yield f"rotation, {stage}", result.rotation.moved.value_mm
    for line in result.lines:
        yield f"along {line.axis}, {stage}", line.straightness.value_mm
    yield f"mean, {stage}", float(errors_mm.mean())
    yield f"max, {stage}", float(errors_mm.max())
    yield f"radius of the sphere, {stage}", result.repeatability.radius.value_mm


@dataclass(frozen=True, slots=True)
class Group:
    """Figures that the paper gives together: what it prints, by quantity."""

    title: str
    experiment: Experiment
    printed: Mapping[str, str]


GROUPS = (
    Group(
        "Fig. 7: largest error of distance, Table I's errors",
        SIMULATION,
        {
            "fitted pairs, before": "about 10",
            "fitted pairs, after": "< 0.01",
            "unseen pairs, after": "",
        },
    ),
    Group(
        "Section IV.D: parameters missed by",
        SIMULATION,
        {
            "worst of 18 lengths": "about 0.05",
            "middle one of 18 lengths": "",
            "worst of 4 angles": "about 0.002",
            "middle one of 4 angles": "",
        },
    ),
    Group(
        "Section IV.D: the same with ± 0.4/√3 mm of repeatability",
        REPEATABILITY,
        {
            "fitted pairs, after": "about 0.3",
            "worst of 18 lengths": "about 1",
            "worst of 4 angles": "about 0.1",
        },
    ),
    Group(
        "Section IV.E.1: repeatability, 28 approaches",
        PROTOTYPE,
        {"radius of the sphere, before": "about 0.4"},
    ),
    Group(
        "Fig. 8: largest error of distance, Table II's errors",
        PROTOTYPE,
        {
            "fitted pairs, before": "> 20",
            "fitted pairs, after": "about 0.6",
            "unseen pairs, after": "",
        },
    ),
    Group(
        "Section IV.E.3: motion while only θ turns",
        PROTOTYPE,
        {"rotation, before": "about 2", "rotation, after": "0.2"},
    ),
    Group(
        "Table III: straightness",
        PROTOTYPE,
        {
            "along x, before": "5.48",
            "along x, after": "0.20",
            "along y, before": "5.62",
            "along y, after": "0.61",
            "along z, before": "0.91",
            "along z, after": "0.55",
        },
    ),
    Group(
        "Table IV: errors of distances, validation points",
        PROTOTYPE,
        {"mean, before": "7.3", "mean, after": "0.4", "max, before": "15.2", "max, after": "1.2"},
    ),
)


def table(title: str, rows: Iterator[tuple[str, str, str]]) -> None:
    """Print a table of names, the paper's values and ours."""
    print(f"\n{title}")
    for name, printed, ours in (("", "paper", "ours"), *rows):
        print(f"  {name:32} {printed:>12} {ours:>10}")


Results = Mapping[Experiment, list[Quantities]]


def group_rows(group: Group, results: Results) -> Iterator[tuple[str, str, str]]:
    """Printed figures, and our median over the seeds."""
    for name, printed in group.printed.items():
        ours = median(seed[name] for seed in results[group.experiment])
        yield name, printed, f"{ours:.4f}" if "angles" in name else f"{ours:.3f}"


def parameter_rows(experiment: Experiment, results: Results) -> Iterator[tuple[str, str, str]]:
    """Printed errors of parameters, which the simulated robot has, and the median of ours."""
    for name, error in load_scenario(experiment.scenario).robot.errors.items():
        ours = median(seed[name] for seed in results[experiment])
        yield name, f"{error:+.2f}", f"{ours:+.3f}"


def main(seeds: int, progress: Callable[[str], None] = lambda _: None) -> Results:
    """Measure the seeds of each experiment and print the tables."""
    results: dict[Experiment, list[Quantities]] = {}
    for experiment in (SIMULATION, REPEATABILITY, PROTOTYPE):
        for seed in range(1, seeds + 1):
            progress(f"{experiment.scenario}, seed {seed} of {seeds}")
            found = quantities(*measured(experiment, seed))
            results.setdefault(experiment, []).append(found)
    print(f"medians of {seeds} seeds, mm and deg")
    table("Table I: errors of the simulated robot", parameter_rows(SIMULATION, results))
    for group in GROUPS:
        table(group.title, group_rows(group, results))
    table("Table II: errors of the prototype", parameter_rows(PROTOTYPE, results))
    return results


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1, lambda text: print(text, file=sys.stderr))
