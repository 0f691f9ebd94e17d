"""The forward and inverse model on a million random reachable poses of each robot.

python -m benchmarks.kinematics [--robot NAME] [--poses N] [--seed N] [--json]

The robots are a shipped one and one like it with errors of manufacture: Par4's by Table I, another
mechanism's drawn. Worst errors there and back, poses that ended elsewhere or nowhere, and poses a
second of one core's time, without a hint and from one a few millimetres off. Exit code 1 when a
figure misses its limit.
"""

import time

import numpy as np

from benchmarks.shared.yardstick import Figure, Report, main
from campaigns.design.pose_sampling import workspace_poses
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.par4 import PAR4
from campaigns.robots.robot import RobotFile, find_robot
from sim.scenarios.scenario import load_scenario

BATCH = 50_000
HINT_OFF = np.array([5.0, 5.0, 5.0, 0.02])
"""A commanded pose is about this far from the pose that a robot with errors takes, mm and rad."""
ERRORS = (1.5, np.radians(0.4))
"""Errors of manufacture of lengths and angles, 1 σ, mm and rad."""
ELSEWHERE = 1e-3
"""Further from the pose it came from, an answer is another assembly."""
IN_DEG = np.array([1.0, 1.0, 1.0, 180.0 / np.pi])
LIMIT = 1e-8
LEAST_POSES_PER_S = {"par4": 300_000}
LEAST_OF_OTHERS = 100_000


def measure(robot: str, poses: int, seed: int) -> Report:
    file = find_robot(robot).robot
    nominal = file.kinematics
    errors = "Table I" if file.mechanism.name == PAR4.name else "errors"
    robots = {robot: nominal, f"{robot} + {errors}": true_robot(nominal, seed)}
    return Report([each for item in robots.items() for each in figures(*item, file, poses, seed)])


def true_robot(nominal: Kinematics, seed: int) -> Kinematics:
    """The nominal with errors of manufacture."""
    mechanism, p = nominal.mechanism, nominal.p.copy()
    if mechanism.name == PAR4.name:
        return Kinematics.of(PAR4, load_scenario("paper-simulation").robot.true_flat())
    free = mechanism.parameters.places(mechanism.parameters.free_by_default)
    std = np.where(mechanism.parameters.is_angle[free], *ERRORS[::-1])
    p[free] += std * np.random.default_rng(seed).standard_normal(len(free))
    return Kinematics(mechanism, p)


def figures(
    name: str, geometry: Kinematics, robot: RobotFile, count: int, seed: int
) -> list[Figure]:
    there = back = wrong = lost = 0.0
    seconds: dict[str, float] = dict.fromkeys(("inverse", "forward", "forward from a hint"), 0.0)
    rng = np.random.default_rng(seed)
    for first in range(0, count, BATCH):
        size, centre = min(BATCH, count - first), robot.workspace_centre
        poses = workspace_poses(geometry, robot.limits, centre, size, rng)
        hints = poses + rng.uniform(-1.0, 1.0, poses.shape) * HINT_OFF[: poses.shape[1]]
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
            in_files = robot.mechanism.joints[0].to_file(1.0)
            off_joints = in_files * np.abs(again - joints[found][same])
            lost += (~found).sum()
            wrong += (~same).sum()
            there = max(there, float((off[same] * IN_DEG[: off.shape[1]]).max(initial=0.0)))
            back = max(back, float(off_joints.max(initial=0.0)))
    least = {"forward": LEAST_POSES_PER_S.get(robot.mechanism.name, LEAST_OF_OTHERS)}
    unit = "°" if robot.mechanism.joints[0].is_revolute else "mm"
    return [
        Figure(f"{name}: forward of inverse", there, "mm, °", highest=LIMIT),
        Figure(f"{name}: inverse of forward", back, unit, highest=LIMIT),
        Figure(f"{name}: wrong", float(wrong), f"of {count}, twice", highest=0.0),
        Figure(f"{name}: lost", float(lost), f"of {count}, twice", highest=0.0),
        *(
            Figure(f"{name}: {way}", count / took_s, "poses/s", lowest=least.get(way, -np.inf))
            for way, took_s in seconds.items()
        ),
    ]


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, robot="par4-prototype", poses=1_000_000, seed=0))
