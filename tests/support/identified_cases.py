"""Shots of known robots, made without a campaign."""

import json
from dataclasses import replace

import numpy as np
from fake_cell import CENTRE, NOMINAL
from family_cases import VECTORS, flat_in
from par4_space import par4
from small_plans import LIMITS

from campaigns.design.pose_sampling import FeasibleRegion, interior_poses
from campaigns.fit.rigid_transforms import from_paper_angles
from campaigns.kinematics.mechanism import Kinematics
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

NOISE_MM = 0.015 / 3**0.5
TRACKER_FROM_BASE = from_paper_angles(np.array([2.1, 0.02, -0.03]), np.array([2500.0, 400, 300]))
_TABLE1 = json.loads((VECTORS / "table1-exact.json").read_text(encoding="utf-8"))
TRUTH = par4(flat_in(_TABLE1["truth"]))


def simulated(fitted: int, unseen: int, seed: int, truth: Kinematics = TRUTH) -> Shots:
    """Pairs measured by a perfect tracker, which states nothing; a seed gives their places."""
    tracker_mm, facing = np.array([2500.0, 0.0, 0.0]), np.eye(3)[0]
    region = FeasibleRegion(NOMINAL, LIMITS, CENTRE, tracker_mm, facing, np.pi)
    count = 2 * (fitted + unseen)
    poses = interior_poses(region, count, np.random.default_rng(seed))
    joints = NOMINAL.inverse(poses).values_or_raise()
    points = TRACKER_FROM_BASE.apply(truth.forward(joints).values_or_raise()[:, :3])
    purposes = [ShotSet.IDENTIFICATION] * (2 * fitted) + [ShotSet.VALIDATION] * (2 * unseen)
    return Shots(
        numbers=tuple(range(count)),
        purposes=tuple(purposes),
        pairs=tuple(np.repeat(np.arange(fitted + unseen), 2).tolist()),
        joints=joints,
        points_in_tracker_mm=points,
        stated_covariance_mm2=np.full((count, 3, 3), np.nan),
        approach=np.zeros_like(joints),
        commanded=np.full((count, 4), np.nan),
        measured_utc=("",) * count,
        temperature_degC=np.full(count, np.nan),
    )


def noisy(data: Shots, seed: int, std_mm: float = NOISE_MM) -> Shots:
    """With noise of which the tracker states the deviation."""
    noise = np.random.default_rng(seed).normal(0.0, std_mm, data.points_in_tracker_mm.shape)
    covariance = np.tile(std_mm**2 * np.eye(3), (len(data.numbers), 1, 1))
    points = data.points_in_tracker_mm + noise
    return replace(data, points_in_tracker_mm=points, stated_covariance_mm2=covariance)
