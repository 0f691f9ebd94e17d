"""The rotary Delta of the reference model: its robots, poses, shots and answers."""

import json
from pathlib import Path

import numpy as np

from campaigns.design.pose_sampling import FeasibleRegion, interior_poses
from campaigns.mechanisms.delta import DELTA
from campaigns.mechanisms.mechanism import Kinematics, Limits

FAMILY = Path(__file__).parents[1] / "data" / "family"
REFERENCE = json.loads((FAMILY / "kinematics.json").read_text(encoding="utf-8"))["delta"]
CASES = dict(zip(("nominal", "perturbed"), REFERENCE["cases"], strict=True))
SPACE = DELTA.parameters


def flat_in(document):
    """Values by name of the arms in a document, mm and deg."""
    arms = enumerate(document["arms"])
    return {f"arm{i}.{key}": value for i, arm in arms for key, value in arm.items()}


def delta_in(document):
    return Kinematics.of(DELTA, flat_in(document))


def delta_of(vector):
    """Robot of a vector, mm and rad."""
    return Kinematics(DELTA, vector)


def poses_of(case):
    return np.array(case["poses_mm_deg"])


def joints_of(case):
    return np.radians(case["joints"])


def shots_file(name):
    return FAMILY / f"delta-{name}.csv"


def answers(name):
    """Nominal, truth and least-squares solution of the shots of that name."""
    return json.loads((FAMILY / f"delta-{name}.json").read_text(encoding="utf-8"))


NOMINAL = delta_in(CASES["nominal"]["geometry"])
PERTURBED = delta_in(CASES["perturbed"]["geometry"])
TILTED = delta_of(
    np.concatenate([PERTURBED.p[: len(SPACE.names)], [0.03, -0.02, 0.05, 0.01, 0.004, -0.006]])
)
"""Far more than a workshop would leave, so that no sign and no size goes unnoticed."""
ROBOTS = {"nominal": NOMINAL, "perturbed": PERTURBED, "perturbed + axis tilts": TILTED}
LIMITS = Limits(tuple(np.radians([-40.0, 85.0])), (None, None, None), np.radians(45.0))
CENTRE = np.array([0.0, 0.0, -700.0])


def reachable_poses(robot, count, seed, limits=LIMITS):
    tracker_mm, facing = np.array([2500.0, 0.0, -600.0]), np.array([1.0, 0.0, 0.0])
    region = FeasibleRegion(robot, limits, CENTRE, tracker_mm, facing, np.pi)
    return interior_poses(region, count, np.random.default_rng(seed))


def reachable_joints(robot, count, seed, limits=LIMITS):
    return robot.inverse(reachable_poses(robot, count, seed, limits)).values_or_raise()
