"""Reach of a robot below its base: the workspace's centre where its robot file states none.

Several steps of the work begin from a pose well inside the workspace. If the robot file gives
none, it is searched on the vertical through the middle of the base: at each height the largest
flat ball is found that the robot can fill without a gap, and the centre is the middle of the
heights whose ball is nearly the largest. All limits of the robot count (joints, swing,
singularity, elbows), so the result is a place to work at, not only one within the forearms'
length. The search tries tens of thousands of poses in batches and takes no derivative, since the
reach has kinks where one limit takes over from another.
"""

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import ConfigInvalid
from campaigns.kinematics.feasibility import Limits, search_extent
from campaigns.kinematics.model import Kinematics
from drivers.values import Vector3, vector


def middle_of_reach_mm(kinematics: Kinematics, limits: Limits) -> Vector3:
    """Return the place on the base's axis from which the robot reaches furthest, (x, y, z) mm.

    The axis is upright through the mean of the arms' places. Raise `ConfigInvalid` when no pose
    below the base can be reached.
    """
    # 1. Go down the axis in equal steps, to twice the depth of the box that holds all that the
    #    robot reaches.
    # 2. Measure the reach at each height.
    # 3. Take the mean of all heights with at least 95 % of the largest reach. The reach is nearly
    #    flat about its top and known in steps only, so the single largest value would be arbitrary.
    # 4. Round to 10 mm: a number for people, far inside what the limits leave.
    origin = np.zeros(len(kinematics.mechanism.task))
    origin[:3] = base_mm(kinematics).mean(axis=0)
    extent = search_extent(kinematics.mechanism, kinematics.p, limits, origin)
    below_mm = np.linspace(0.0, 2.0 * float(extent[2]), 200)
    reaches = np.array([_reach_mm(kinematics, limits, origin, depth, extent) for depth in below_mm])
    if not (reaches > 0.0).any():
        raise ConfigInvalid(
            "a robot of these sizes reaches nothing below the middle of its base",
            remedy="check the sizes: the forearms must span from the arms' ends to the platform",
        )
    origin[2] -= below_mm[reaches >= 0.95 * reaches.max()].mean()
    return vector(10.0 * np.round(origin[:3] / 10.0) + 0.0)


def base_mm(kinematics: Kinematics) -> Array:
    """Return the places of the arms' motors, or of their rails' zeros, (n, 3), mm."""
    space = kinematics.mechanism.parameters
    values = dict(zip(space.names, kinematics.p.tolist(), strict=False))  # extensions come after
    return np.array(
        [[values.get(f"arm{arm}.{axis}_mm", 0.0) for axis in "xyz"] for arm in range(space.arms)]
    )


# Rays go out level in eight directions, and up and down at half the length, for workspaces of these
# robots are flat. The reach ends at the first distance at which any ray meets a pose that cannot be
# taken: poses beyond a gap do not count, because the robot would have to pass the gap.
def _reach_mm(
    kinematics: Kinematics, limits: Limits, origin: Array, below_mm: float, extent: Array
) -> float:
    """Return the level radius of the largest reachable ball about a place on the axis, mm, or 0."""
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
