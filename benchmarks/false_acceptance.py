"""Count how often `identify` says "pass" of a robot that it has wrong.

python -m benchmarks.false_acceptance [--mechanisms NAME …] [--kinds SITUATION …] [--campaigns N] …

Each campaign draws a robot with errors of geometry and one kind of further error, measures it
by the simulator's rods and a tracker whose noise is as it is stated, and identifies it. A pass is
wrong if a parameter is off by more than 4 σ, or positions by more than twice what is stated.
`benchmarks.situations` has more kinds of trouble and looks at what findings name.
"""

import argparse
import math
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from benchmarks.situations import WRONG_POSITIONS
from benchmarks.true_campaigns import (
    PLANS_FOLDER,
    measure,
    planned_shots,
    position_error_um,
    streams_of,
)
from benchmarks.truths import ROBOTS, Situation, TrueRobot, draw_robot
from campaigns.errors import CampaignError
from campaigns.robots.robot import RobotFile
from pkmcal import find_robot, identify

KINDS = (
    "clean",
    *(f"eccentricity {size}" for size in (0.005, 0.01, 0.03)),
    *(f"ratio {size}" for size in (200, 1000)),
    *(f"azimuths {size}" for size in (0.2, 0.5)),
    *(f"rods {size}" for size in (0.05, 0.2)),
    *(f"tilts {size}" for size in (0.5, 2.0)),
    *(f"backlash {size}" for size in (0.3, 1.0)),
    *(f"yield {size}" for size in (0.05, 0.2)),
    *(f"ripple {size}" for size in (0.17, 0.33, 1)),
    *("small", "encoder 0.05 from 30", "mount 0.3 from 30", "wrong 1 x 2"),
)
WRONG_SIGMAS = 4.0


def has_parameters(situation: Situation, truth: TrueRobot) -> bool:
    """Whether `TrueRobot.known` describes a robot completely."""
    lacking = ["yield", "ripple"]
    lacking += ["azimuths", "tilts"] if truth.kind.on_rails else []
    return not any(situation.size(effect) for effect in lacking)


def judge(
    mechanism: str, kind: str, shots: int, seed: int, folder: Path
) -> tuple[str, float, float]:
    """Return a verdict, the worst parameter's error in σ, positions' over what is stated."""
    situation, streams = Situation.parse(kind), streams_of(mechanism, seed)
    robot = find_robot(ROBOTS[mechanism])
    planned = planned_shots(mechanism, shots, seed, folder)
    truth = draw_robot(robot, situation, planned, streams)
    measured = measure(robot, truth, situation, planned, streams)
    try:
        result: Any = identify(measured.shots, robot)
    except CampaignError as error:
        return type(error).__name__, math.nan, math.nan
    known = measured.now.known() if has_parameters(situation, truth) else {}
    off, stated = parameter_errors(result, robot, known), result.uncertainty.position_std_mm
    if stated is None:
        return str(result.judgement.verdict), off, math.nan
    real_um = position_error_um(robot, measured.now, result)
    return str(result.judgement.verdict), off, real_um / (1e3 * stated.rms)


def parameter_errors(result: Any, robot: RobotFile, known: dict[str, float]) -> float:
    """Return the largest error of a parameter in its σ, in the datum of the result."""
    posterior, table = result.uncertainty.posterior, robot.mechanism.parameters
    parameters = result.value.parameters
    if posterior is None or not known:
        return 0.0
    names = [name for name in posterior.names if name in parameters]
    tolerance, units = np.array(posterior.tolerances), np.ones(len(posterior.names))
    units[: len(names)] = table.file_unit[table.places(names)]
    nominal = {name: parameters[name].nominal for name in names}
    true = np.zeros(len(posterior.names))
    true[: len(names)] = [known.get(name, nominal[name]) - nominal[name] for name in names]
    true *= units / tolerance
    # what no shot determines is where the priors like it best: the truth, too, is put there
    null = np.array(posterior.undetermined).reshape(-1, len(true)).T
    groups = [table[n].field.group if n in parameters else n for n in posterior.names]
    precision = np.array([posterior.sizes.get(group, 1.0) for group in groups])[:, None] ** -2
    shares = np.linalg.solve(null.T @ (precision * null), (precision * null).T @ true)
    true = (true - null @ shares) * tolerance / units
    rows = zip(names, true.tolist(), strict=False)
    fitted = ((parameters[name], value) for name, value in rows)
    return max((abs(p.delta - value) / p.std for p, value in fitted if p.std), default=0.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--mechanisms", nargs="+", default=list(ROBOTS), choices=list(ROBOTS))
    parser.add_argument("--kinds", nargs="+", default=KINDS)
    for option, default in (("campaigns", 12), ("shots", 60), ("seed", 1), ("jobs", 2)):
        parser.add_argument(f"--{option}", type=int, default=default)
    parser.add_argument("--plans", type=Path, default=PLANS_FOLDER)
    asked = parser.parse_args()
    print(f"{'':35} pass  wrong  other   worst σ   positions (medians)", flush=True)
    for mechanism, kind in product(asked.mechanisms, asked.kinds):
        if not Situation.parse(kind).suits(mechanism):
            continue
        seeds = range(asked.seed, asked.seed + asked.campaigns)
        at = (mechanism, kind, asked.shots)
        rows = Parallel(asked.jobs)(delayed(judge)(*at, seed, asked.plans) for seed in seeds)
        passed = [row for row in rows if row[0] == "pass"]
        wrong = [row for row in passed if row[1] > WRONG_SIGMAS or row[2] > WRONG_POSITIONS]
        sigmas, positions = np.nanmedian([row[1:] for row in rows], axis=0)
        counts = f"{len(passed):5}{len(wrong):7}{len(rows) - len(passed):7}"
        print(f"{mechanism:13}{kind:22}{counts}{sigmas:10.1f}{positions:12.2f}", flush=True)


if __name__ == "__main__":
    main()
