"""Par4's contracted model (paper eqs. 1-13, corrected): closure, inverse, Jacobians.

Arrays are batched: joints (N, 4) in rad as the encoders read them; poses (N, 4) as X, Y, Z in mm
and θ in rad. The corrections of the printed equations are in docs/model.md.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from campaigns.numerics.geometry import COUNT, Array, Geometry, Mask
from campaigns.parameters import ARM_FIELDS, ARMS

PLATE_LEVER_MM = 100.0
"""Turns θ's column into a length before anything looks at singular values."""


class Assembly(IntEnum):
    """Outcome of a kinematic solution."""

    FOUND = 0
    NONE = 1
    """The mechanism cannot be assembled there."""


class NoAssembly(ValueError):
    """A pose or a set of joints at which the mechanism cannot be assembled."""


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Values (N, 4) and each row's outcome; rows without an assembly hold NaN.

    Whoever has not looked at the outcomes takes the values by `require`.
    """

    values: Array
    outcome: NDArray[np.uint8]

    @property
    def found(self) -> Mask:
        """Which rows hold an answer, (N,)."""
        return np.asarray(self.outcome == Assembly.FOUND)

    def require(self) -> Array:
        """All values; raises `NoAssembly` naming the first row that has none."""
        if not np.all(self.found):
            row = int(np.argmin(self.found))
            raise NoAssembly(f"no assembly for row {row} of {len(self.outcome)}")
        return self.values


def arm_directions(geometry: Geometry) -> Array:
    """u_i, the arm's direction at zero joint angle, (4, 3) (eq. 5)."""
    cos, sin = np.cos(geometry.azimuth_rad), np.sin(geometry.azimuth_rad)
    return np.column_stack([cos, sin, np.zeros_like(cos)])


def motor_axes(geometry: Geometry) -> Array:
    """v_i, the motor's axis, (4, 3) (eq. 6)."""
    cos, sin = np.cos(geometry.azimuth_rad), np.sin(geometry.azimuth_rad)
    return np.column_stack([-sin, cos, np.zeros_like(cos)])


def elbows_mm(geometry: Geometry, joints_rad: Array) -> Array:
    """A_i in the base frame, (N, 4, 3) (eq. 8); a positive angle lowers the elbow."""
    angle = joints_rad + geometry.joint_offset_rad
    arms = np.zeros_like(angle, shape=(*angle.shape, 3))
    outward = geometry.arm_mm * np.cos(angle)
    arms[..., 0] = outward * np.cos(geometry.azimuth_rad)
    arms[..., 1] = outward * np.sin(geometry.azimuth_rad)
    arms[..., 2] = -geometry.arm_mm * np.sin(angle)
    return geometry.motor_mm + arms


def plate_joints_mm(geometry: Geometry, poses: Array) -> Array:
    """B'_i in the base frame, (N, 4, 3) (eq. 9)."""
    joints = np.repeat(poses[..., None, :3], 4, axis=-2)
    joints[..., 2:, 0] -= geometry.plate_mm * np.sin(poses[..., 3, None])
    joints[..., 2:, 1] += geometry.plate_mm * np.cos(poses[..., 3, None])
    return joints


def forearms_mm(geometry: Geometry, joints_rad: Array, poses: Array) -> Array:
    """A_iB'_i, (N, 4, 3)."""
    return plate_joints_mm(geometry, poses) - elbows_mm(geometry, joints_rad)


def closure_mm2(geometry: Geometry, joints_rad: Array, poses: Array) -> Array:
    """|A_iB'_i|² - L_i², (N, 4); zero when assembled (eq. 3 with L_i for the printed l_i)."""
    forearms = forearms_mm(geometry, joints_rad, poses)
    return np.asarray(np.einsum("...k,...k->...", forearms, forearms) - geometry.forearm_mm**2)


def inverse(geometry: Geometry, poses: Array) -> Solution:
    """Encoder angles of poses, on the branch with the elbow outward (eqs. 10-14 as corrected)."""
    motor_to_plate = plate_joints_mm(geometry, poses) - geometry.motor_mm
    along = np.einsum("...ik,ik->...i", motor_to_plate, arm_directions(geometry))
    down = motor_to_plate[..., 2]
    sine = 2.0 * geometry.arm_mm * down
    cosine = -2.0 * geometry.arm_mm * along
    constant = (
        np.einsum("...k,...k->...", motor_to_plate, motor_to_plate)
        + geometry.arm_mm**2
        - geometry.forearm_mm**2
    )
    discriminant = sine**2 + cosine**2 - constant**2
    found = np.all(discriminant >= 0.0, axis=-1)
    root = np.sqrt(np.where(discriminant >= 0.0, discriminant, np.nan))
    # the same root as eq. 14's half-angle form, without its 0/0 where both of its arguments vanish
    angle = np.arctan2(sine, cosine) + np.arctan2(root, -constant) - geometry.joint_offset_rad
    joints = np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi
    joints[~found] = np.nan
    return Solution(joints, np.where(found, Assembly.FOUND, Assembly.NONE).astype(np.uint8))


def pose_jacobian(geometry: Geometry, joints_rad: Array, poses: Array) -> Array:
    """∂F/∂(X, Y, Z, θ) of the closures, (N, 4, 4), in mm (θ's column mm² per rad)."""
    return _by_pose(geometry, poses, forearms_mm(geometry, joints_rad, poses))


def closure_parameter_jacobian(geometry: Geometry, joints_rad: Array, poses: Array) -> Array:
    """∂F_i of arm i by its own seven parameters and by the plate's length, (N, 4, 8)."""
    forearms = forearms_mm(geometry, joints_rad, poses)
    return _by_own_parameters(geometry, joints_rad, poses, forearms)


def parameter_jacobian(geometry: Geometry, joints_rad: Array, poses: Array) -> Array:
    """d(X, Y, Z, θ)/dK at fixed joints, (N, 4, 29): implicit function theorem on the closures.

    Raises `numpy.linalg.LinAlgError` at a singular pose.
    """
    forearms = forearms_mm(geometry, joints_rad, poses)
    own = _by_own_parameters(geometry, joints_rad, poses, forearms)
    by_all = np.zeros((*poses.shape[:-1], ARMS, COUNT))
    for arm in range(ARMS):
        columns = slice(arm * len(ARM_FIELDS), (arm + 1) * len(ARM_FIELDS))
        by_all[..., arm, columns] = own[..., arm, :-1]
    by_all[..., -1] = own[..., -1]
    return np.asarray(-np.linalg.inv(_by_pose(geometry, poses, forearms)) @ by_all)


def _by_pose(geometry: Geometry, poses: Array, forearms: Array) -> Array:
    """∂F/∂(X, Y, Z, θ), (N, 4, 4)."""
    jacobian = np.zeros_like(forearms, shape=(*poses.shape[:-1], ARMS, 4))
    jacobian[..., :3] = 2.0 * forearms
    x, y = forearms[..., 2:, 0], forearms[..., 2:, 1]
    sin, cos = np.sin(poses[..., 3, None]), np.cos(poses[..., 3, None])
    jacobian[..., 2:, 3] = -2.0 * geometry.plate_mm * (cos * x + sin * y)
    return jacobian


def _by_own_parameters(
    geometry: Geometry, joints_rad: Array, poses: Array, forearms: Array
) -> Array:
    """∂F_i by the parameters of arm i in the order of `ARM_FIELDS`, then by h, (N, 4, 8)."""
    x, y, up = forearms[..., 0], forearms[..., 1], forearms[..., 2]
    cos, sin = np.cos(geometry.azimuth_rad), np.sin(geometry.azimuth_rad)
    along, across = cos * x + sin * y, cos * y - sin * x
    angle = joints_rad + geometry.joint_offset_rad
    cos, sin = np.cos(angle), np.sin(angle)
    jacobian = np.zeros_like(forearms, shape=(*poses.shape[:-1], ARMS, len(ARM_FIELDS) + 1))
    jacobian[..., :3] = -2.0 * forearms
    jacobian[..., 3] = -2.0 * geometry.arm_mm * cos * across
    jacobian[..., 4] = 2.0 * geometry.arm_mm * (sin * along + cos * up)
    jacobian[..., 5] = -2.0 * (cos * along - sin * up)
    jacobian[..., 6] = -2.0 * geometry.forearm_mm
    sin, cos = np.sin(poses[..., 3, None]), np.cos(poses[..., 3, None])
    jacobian[..., 2:, 7] = 2.0 * (cos * y[..., 2:] - sin * x[..., 2:])
    return jacobian
