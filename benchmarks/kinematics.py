"""The forward and inverse model on a million random reachable poses of each robot.

python -m benchmarks.kinematics [--poses N] [--seed N] [--json]

Worst errors there and back, poses that ended elsewhere or nowhere, and poses a second of one core's
time, without a hint and from one a few millimetres off. Exit code 1 when a figure misses its limit.
"""

import time
from collections.abc import Iterator

import numpy as np

from benchmarks.shared.prototype import CENTRE, NOMINAL, ROBOT
from benchmarks.shared.yardstick import Figure, Report, main
from campaigns.arrays import Array
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.par4 import PAR4
from campaigns.robots.robot import pose_row
from sim.scenarios.scenario import load_scenario

BOX_HALF = np.array([700.0, 700.0, 450.0, np.pi / 4])
BATCH = 50_000
HINT_OFF = np.array([5.0, 5.0, 5.0, 0.02])
"""A commanded pose is about this far from the pose that a robot with errors takes."""
ELSEWHERE = 1e-3
"""Further from the pose it came from, an answer is another assembly."""
IN_DEG = np.array([1.0, 1.0, 1.0, 180.0 / np.pi])
LIMIT = 1e-8
LEAST_POSES_PER_S = 300_000


def measure(poses: int, seed: int) -> Report:
    true = load_scenario("paper-simulation").robot.true_flat()
    robots = {
        "par4-prototype": NOMINAL,
        "par4-prototype + Table I": Kinematics.from_flat(PAR4, true),
    }
    return Report([each for item in robots.items() for each in figures(*item, poses, seed)])


def figures(name: str, geometry: Kinematics, count: int, seed: int) -> list[Figure]:
    there = back = wrong = lost = 0.0
    seconds: dict[str, float] = dict.fromkeys(("inverse", "forward", "forward from a hint"), 0.0)
    rng = np.random.default_rng(seed)
    for poses in batches(geometry, count, rng):
        hints = poses + rng.uniform(-1.0, 1.0, poses.shape) * HINT_OFF
        began_s = time.process_time()
        joints = geometry.inverse(poses).values_or_raise()
        inverse_s = time.process_time()
        cold = geometry.forward(joints)
        forward_s = time.process_time()
        warm = geometry.forward(joints, hints)
        ends_s = (inverse_s, forward_s, time.process_time())
        for way, start_s, end_s in zip(seconds, (began_s, *ends_s), ends_s, strict=False):
            seconds[way] += end_s - start_s
        for solution in (cold, warm):
            found = solution.found
            off = np.abs(solution.values[found] - poses[found])
            same = (off < ELSEWHERE).all(axis=1)
            again = geometry.inverse(solution.values[found][same]).values_or_raise()
            off_deg = np.degrees(np.abs(again - joints[found][same]))
            lost += (~found).sum()
            wrong += (~same).sum()
            there = max(there, float((off[same] * IN_DEG).max(initial=0.0)))
            back = max(back, float(off_deg.max(initial=0.0)))
    least = {"forward": LEAST_POSES_PER_S}
    return [
        Figure(f"{name}: forward of inverse", there, "mm, °", highest=LIMIT),
        Figure(f"{name}: inverse of forward", back, "°", highest=LIMIT),
        Figure(f"{name}: wrong", float(wrong), f"of {count}, twice", highest=0.0),
        Figure(f"{name}: lost", float(lost), f"of {count}, twice", highest=0.0),
        *(
            Figure(f"{name}: {way}", count / took_s, "poses/s", lowest=least.get(way, -np.inf))
            for way, took_s in seconds.items()
        ),
    ]


def batches(geometry: Kinematics, count: int, rng: np.random.Generator) -> Iterator[Array]:
    """Random reachable poses, (N, 4) at a time, until there are `count` of them."""
    left = count
    while left > 0:
        drawn = pose_row(CENTRE) + rng.uniform(-1.0, 1.0, (BATCH, 4)) * BOX_HALF
        poses = drawn[geometry.feasibility(ROBOT.limits, drawn).feasible][:left]
        left -= len(poses)
        yield poses


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, poses=1_000_000, seed=0))
