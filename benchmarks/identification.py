"""What identification costs: both estimators on 60 measured pairs, and the fit while measuring.

python benchmarks/identification.py [--json]

Medians of 21, in milliseconds, for tests/data/vectors/table1-tracker-noise.csv.
"""

import argparse
import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from campaigns.numerics.fit import solve
from campaigns.numerics.geometry import FREE_BY_DEFAULT, Array, Geometry, indices
from campaigns.numerics.pairs import distances_mm
from campaigns.numerics.residuals import DistanceResiduals, PointResiduals, PositionModel
from campaigns.numerics.running import RunningFit
from campaigns.robot import find_robot

SHOTS = Path(__file__).parents[1] / "tests/data/vectors/table1-tracker-noise.csv"
VARIANCE_MM2 = 0.015**2 / 3.0
FREE = indices(FREE_BY_DEFAULT)
REPEATS = 21
RUNNING_AT = (20, 60, 160)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    nominal = Geometry.from_flat(find_robot("par4-prototype").robot.geometry_flat())
    shots = np.loadtxt(SHOTS, delimiter=",", skiprows=1)
    joints, points = np.radians(shots[:, 1:5]), shots[:, 5:]
    figures = {
        "distances_solve_ms": median_ms(lambda: by_distances(nominal, joints, points)),
        "points_solve_ms": median_ms(lambda: by_points(nominal, joints, points)),
        **running_ms(nominal, joints, points),
    }
    if asked.json:
        print(json.dumps(figures, indent=1))
    else:
        for name, value in figures.items():
            print(f"{name:28} {value:7.2f}")


def median_ms(work: Callable[[], object]) -> float:
    return float(np.median([timed_ms(work) for _ in range(REPEATS)]))


def timed_ms(work: Callable[[], object]) -> float:
    began_s = time.perf_counter()
    work()
    return 1e3 * (time.perf_counter() - began_s)


def by_distances(nominal: Geometry, joints: Array, points: Array) -> None:
    first, second = np.arange(0, len(joints), 2), np.arange(1, len(joints), 2)
    measured = distances_mm(points, first, second)
    model = PositionModel(nominal, FREE, joints)
    assert solve(DistanceResiduals(model, first, second, measured)).converged


def by_points(nominal: Geometry, joints: Array, points: Array) -> None:
    covariance = np.broadcast_to(VARIANCE_MM2 * np.eye(3), (len(points), 3, 3))
    model = PositionModel(nominal, FREE, joints)
    assert solve(PointResiduals.from_points(model, points, covariance)).converged


def running_ms(nominal: Geometry, joints: Array, points: Array) -> dict[str, float]:
    """What one more shot costs, as the median of the shots around each of `RUNNING_AT`."""
    running, costs = RunningFit(nominal, FREE_BY_DEFAULT), []
    for shot in range(max(RUNNING_AT) + REPEATS // 2 + 1):
        row = shot % len(joints)  # the file has fewer shots: they come round again
        costs.append(timed_ms(partial(running.add, joints[row], points[row])))
    around = {at: costs[max(0, at - REPEATS // 2) : at + REPEATS // 2 + 1] for at in RUNNING_AT}
    return {f"running_add_at_{at}_ms": float(np.median(costs)) for at, costs in around.items()}


if __name__ == "__main__":
    main()
