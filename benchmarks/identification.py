"""What identification costs: both estimators on 60 measured pairs, and the fit while measuring.

python -m benchmarks.identification [--rounds N] [--json]

Milliseconds of one core: medians of 21, of the least disturbed of some rounds. The shots are those
of tests/data/vectors/table1-tracker-noise.csv. Exit code 1 when a solution misses its limit.
"""

import argparse
import json
import os
import statistics
import sys
from collections.abc import Mapping
from functools import partial

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")
# before NumPy is imported: the limits are for one core, and the program itself keeps to one

from benchmarks.shared.measured_robot import (
    SPACE,
    MeasuredRobot,
    by_distances,
    by_points,
    measured_robot,
)
from benchmarks.shared.rounds import contestant, least_s, take_turns, timed_s
from campaigns.estimation.incremental_fit import IncrementalGaussNewton

REPEATS = 21
RUNNING_AT = (20, 60, 160)
LIMITS_MS = {"distances_solve_ms": 4.0, "points_solve_ms": 8.0}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    robot = measured_robot()
    figures = solving_ms(robot, asked.rounds) | running_ms(robot)
    if asked.json:
        print(json.dumps(figures | {"limits": LIMITS_MS}, indent=1))
    else:
        show(figures)
    return int(any(figures[name] > limit for name, limit in LIMITS_MS.items()))


def show(figures: Mapping[str, float]) -> None:
    for name, value in figures.items():
        limit = f", limit {LIMITS_MS[name]:g}" if name in LIMITS_MS else ""
        print(f"{name:28} {value:7.2f}{limit}")


def solving_ms(robot: MeasuredRobot, rounds: int) -> dict[str, float]:
    estimators = partial(by_distances, robot), partial(by_points, robot)
    taken = take_turns([contestant(solve, REPEATS) for solve in estimators], rounds)
    return {name: 1e3 * least_s(runs) for name, runs in zip(LIMITS_MS, taken, strict=True)}


def running_ms(robot: MeasuredRobot) -> dict[str, float]:
    """What one more shot costs, as the median of the shots around each of `RUNNING_AT`."""
    running, costs_ms = IncrementalGaussNewton(robot.nominal, SPACE.free_by_default), []
    for shot in range(max(RUNNING_AT) + REPEATS // 2 + 1):
        row = shot % len(robot.joints)  # the file has fewer shots: they come round again
        add = partial(running.add, robot.joints[row], robot.points_mm[row])
        costs_ms.append(1e3 * timed_s(add))
    around = {at: costs_ms[max(0, at - REPEATS // 2) : at + REPEATS // 2 + 1] for at in RUNNING_AT}
    return {f"running_add_at_{at}_ms": statistics.median(some) for at, some in around.items()}


if __name__ == "__main__":
    sys.exit(main())
