"""The controller's own inverse kinematics, by triangles in each arm's plane."""

import math

import numpy as np

from sim.geometry import ARMS, Array, Geometry


class OutOfReach(Exception):
    """The forearm of `arm` cannot be put between its elbow and the plate."""

    def __init__(self, arm: int) -> None:
        super().__init__(f"arm {arm} cannot reach")
        self.arm = arm


def plate_joints_mm(geometry: Geometry, position_mm: Array, theta_rad: float) -> Array:
    """(4, 3): B'_i in the base frame (paper, eq. 9)."""
    h = geometry.plate_mm
    bar_mm = np.array([-h * math.sin(theta_rad), h * math.cos(theta_rad), 0.0])
    return np.array([position_mm, position_mm, position_mm + bar_mm, position_mm + bar_mm])


def joints_for(geometry: Geometry, position_mm: Array, theta_rad: float) -> Array:
    """(4,) encoder angles, rad, with every elbow outward; raises `OutOfReach`."""
    to_plate_mm = plate_joints_mm(geometry, position_mm, theta_rad) - geometry.motors_mm
    return np.array([_joint(geometry, arm, to_plate_mm[arm]) for arm in range(ARMS)])


def _joint(geometry: Geometry, arm: int, to_plate_mm: Array) -> float:
    """The arm's angle is the angle down to the plate joint less the triangle's angle at the motor.

    The triangle is motor, elbow, plate joint in the arm's plane; the forearm counts there with
    what its swing out of the plane leaves of it.
    """
    arm_mm = float(geometry.arms_mm[arm])
    outward_mm = float(to_plate_mm @ geometry.outward[arm])
    swing_mm = float(to_plate_mm @ geometry.sideways[arm])
    squared_in_plane = float(geometry.forearms_mm[arm]) ** 2 - swing_mm**2
    base_mm = math.hypot(outward_mm, float(to_plate_mm[2]))
    if squared_in_plane < 0.0 or base_mm == 0.0:
        raise OutOfReach(arm)
    cosine = (arm_mm**2 + base_mm**2 - squared_in_plane) / (2.0 * arm_mm * base_mm)
    if not -1.0 <= cosine <= 1.0:
        raise OutOfReach(arm)
    down_rad = math.atan2(-float(to_plate_mm[2]), outward_mm)
    angle_rad = down_rad - math.acos(cosine) - float(geometry.joint_offsets_rad[arm])
    return math.remainder(angle_rad, 2.0 * math.pi)
