"""The forward and inverse model on a million random reachable poses of each robot.

python -m benchmarks.kinematics [--poses N] [--seed N] [--json]

Worst errors there and back, poses that ended elsewhere or nowhere, and poses a second of one core's
time, without a hint and from one a few millimetres off. Exit code 1 when a figure misses its limit.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")
# before NumPy is imported: the limit is for one core

import numpy as np

from campaigns.arrays import Array
from campaigns.mechanisms.mechanism import Kinematics, Limits
from campaigns.mechanisms.par4 import PAR4
from campaigns.robots.robot import find_robot
from sim.scenarios.scenario import load_scenario

CENTRE = np.array([0.0, 0.0, -575.0, 0.0])
BOX_HALF = np.array([700.0, 700.0, 450.0, np.pi / 4])
BATCH = 50_000
HINT_OFF = np.array([5.0, 5.0, 5.0, 0.02])
"""A commanded pose is about this far from the pose that a robot with errors takes."""
ELSEWHERE = 1e-3
"""Further from the pose it came from, an answer is another assembly."""
IN_DEG = np.array([1.0, 1.0, 1.0, 180.0 / np.pi])
LIMIT = 1e-8
LEAST_POSES_PER_S = 300_000


@dataclass
class Figures:
    """Sums over batches; errors in mm and deg."""

    poses: int = 0
    forward_of_inverse_mm_deg: float = 0.0
    inverse_of_forward_deg: float = 0.0
    wrong: int = 0
    lost: int = 0
    forward_s: float = 0.0
    forward_from_hint_s: float = 0.0
    inverse_s: float = 0.0

    def good(self) -> bool:
        """Whether every figure keeps its limit."""
        exact = max(self.forward_of_inverse_mm_deg, self.inverse_of_forward_deg) <= LIMIT
        return exact and not self.wrong and not self.lost and self.slowest() >= LEAST_POSES_PER_S

    def slowest(self) -> float:
        """Poses a second of the forward model without a hint."""
        return self.poses / self.forward_s

    def document(self) -> dict[str, float | int]:
        """The figures with speeds in place of times."""
        told = asdict(self)
        for name in ("forward", "forward_from_hint", "inverse"):
            told[f"{name}_poses_per_s"] = round(self.poses / told.pop(f"{name}_s"))
        return told


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--poses", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    prototype = find_robot("par4-prototype").robot
    limits = prototype.limits
    robots = {
        "par4-prototype": prototype.geometry_flat(),
        "par4-prototype + Table I": load_scenario("paper-simulation").robot.true_flat(),
    }
    told = {
        name: measure(Kinematics.from_flat(PAR4, flat), limits, asked.poses, asked.seed)
        for name, flat in robots.items()
    }
    if asked.json:
        print(json.dumps({name: figures.document() for name, figures in told.items()}, indent=1))
    else:
        for name, figures in told.items():
            show(name, figures)
    return 0 if all(figures.good() for figures in told.values()) else 1


def show(name: str, figures: Figures) -> None:
    print(name)
    for key, value in figures.document().items():
        print(f"  {key:34} {value:>12.3g}" if value < 1 else f"  {key:34} {value:>12}")


def measure(geometry: Kinematics, limits: Limits, count: int, seed: int) -> Figures:
    figures, rng = Figures(), np.random.default_rng(seed)
    for poses in batches(geometry, limits, count, rng):
        hints = poses + rng.uniform(-1.0, 1.0, poses.shape) * HINT_OFF
        take_in(figures, geometry, poses, hints)
    return figures


def batches(
    geometry: Kinematics, limits: Limits, count: int, rng: np.random.Generator
) -> Iterator[Array]:
    """Random reachable poses, (N, 4) at a time, until there are `count` of them."""
    left = count
    while left > 0:
        drawn = CENTRE + rng.uniform(-1.0, 1.0, (BATCH, 4)) * BOX_HALF
        poses = drawn[geometry.feasibility(limits, drawn).feasible][:left]
        left -= len(poses)
        yield poses


def take_in(figures: Figures, geometry: Kinematics, poses: Array, hints: Array) -> None:
    began_s = time.process_time()
    joints = geometry.inverse(poses).values_or_raise()
    inverse_done_s = time.process_time()
    cold = geometry.forward(joints)
    forward_done_s = time.process_time()
    warm = geometry.forward(joints, hints)
    figures.forward_from_hint_s += time.process_time() - forward_done_s
    figures.forward_s += forward_done_s - inverse_done_s
    figures.inverse_s += inverse_done_s - began_s
    figures.poses += len(poses)
    for solution in (cold, warm):
        found = solution.found
        off = np.abs(solution.values[found] - poses[found])
        same = (off < ELSEWHERE).all(axis=1)
        again = geometry.inverse(solution.values[found][same]).values_or_raise()
        off_deg = np.degrees(np.abs(again - joints[found][same]))
        figures.lost += int((~found).sum())
        figures.wrong += int((~same).sum())
        figures.forward_of_inverse_mm_deg = max(
            figures.forward_of_inverse_mm_deg, float((off[same] * IN_DEG).max(initial=0.0))
        )
        figures.inverse_of_forward_deg = max(
            figures.inverse_of_forward_deg, float(off_deg.max(initial=0.0))
        )


if __name__ == "__main__":
    sys.exit(main())
