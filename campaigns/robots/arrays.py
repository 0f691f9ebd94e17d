"""Robot files and poses as the numerics want them."""

import numpy as np

from campaigns.numerics.geometry import Array, Geometry
from campaigns.numerics.reach import Limits
from campaigns.robots.robot import RobotFile
from drivers.values import Pose


def numeric_geometry(robot: RobotFile) -> Geometry:
    """The parameter set as arrays."""
    return Geometry.from_flat(robot.geometry_flat())


def numeric_limits(robot: RobotFile) -> Limits:
    """The limits as the numerics want them."""
    return Limits(robot.limits.joint_rad, robot.limits.theta_rad, robot.limits.forearm_swing_rad)


def pose_row(pose: Pose) -> Array:
    """X, Y, Z in mm and θ in rad, (4,)."""
    return np.array([pose.x_mm, pose.y_mm, pose.z_mm, pose.theta_rad], dtype=np.float64)


def pose_of(row: Array) -> Pose:
    """A row (4,) as a pose."""
    return Pose(*(float(value) for value in row))
