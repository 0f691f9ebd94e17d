"""Reach of a robot below its base: the workspace's centre where its file states none."""

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import ConfigInvalid
from campaigns.kinematics.feasibility import Limits, search_extent
from campaigns.kinematics.mechanism import Kinematics
from drivers.values import Vector3, vector


def middle_of_reach_mm(kinematics: Kinematics, limits: Limits) -> Vector3:
    """Place on the base's axis from which the robot reaches furthest, (x, y, z) mm.

    The axis is upright through the mean of the arms' places. Raises `ConfigInvalid` when there is
    none.
    """
    origin = np.zeros(len(kinematics.mechanism.task))
    origin[:3] = base_mm(kinematics).mean(axis=0)
    extent = search_extent(kinematics.mechanism, kinematics.p, limits, origin)
    below_mm = np.linspace(0.0, 2.0 * float(extent[2]), 200)
    reaches = np.array([_reach_mm(kinematics, limits, origin, each, extent) for each in below_mm])
    if not (reaches > 0.0).any():
        raise ConfigInvalid(
            "a robot of these sizes reaches nothing below the middle of its base",
            remedy="check the sizes: the forearms must span from the arms' ends to the platform",
        )
    origin[2] -= below_mm[reaches >= 0.95 * reaches.max()].mean()
    return vector(10.0 * np.round(origin[:3] / 10.0) + 0.0)


def base_mm(kinematics: Kinematics) -> Array:
    """Places of the arms' motors, or of their rails' zeros, (n, 3)."""
    space = kinematics.mechanism.parameters
    values = dict(zip(space.names, kinematics.p.tolist(), strict=False))  # extensions come after
    return np.array(
        [[values.get(f"arm{arm}.{axis}_mm", 0.0) for axis in "xyz"] for arm in range(space.arms)]
    )


def _reach_mm(
    kinematics: Kinematics, limits: Limits, origin: Array, below_mm: float, extent: Array
) -> float:
    """Largest ball about a place on the axis whose surroundings can all be reached; 0 for none."""
    around = 2.0 * np.pi * np.arange(8) / 8
    level = np.column_stack([np.cos(around), np.sin(around), np.zeros(8)])
    directions = np.vstack([level, [[0.0, 0.0, 0.5], [0.0, 0.0, -0.5]]])
    reaches = np.linspace(0.0, float(extent[0]), 40)
    poses = np.tile(origin, (len(reaches), len(directions), 1))
    poses[:, :, 2] -= below_mm
    poses[:, :, :3] += reaches[:, None, None] * directions
    feasible = kinematics.feasibility(limits, poses.reshape(-1, len(extent))).feasible
    whole = np.logical_and.accumulate(feasible.reshape(len(reaches), -1).all(axis=1))
    return float(reaches[whole][-1]) if whole.any() else 0.0
