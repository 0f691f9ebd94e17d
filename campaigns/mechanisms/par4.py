"""Par4's contracted model (paper eqs. 1-13, corrected): closure, inverse, Jacobians.

Beyond the paper a motor's axis may be tilted out of the horizontal: turned by τ_i about u_i.

Arrays are batched: joints (N, 4) in rad as the encoders read them; poses (N, 4) as X, Y, Z in mm
and θ in rad. The corrections of the printed equations are in docs/model.md.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from campaigns.arrays import Array, Mask
from campaigns.mechanisms.geometry import (
    ARM_FIELDS,
    ARMS,
    GEOMETRY_NAMES,
    PLATE,
    TILTS,
    Geometry,
)

PLATE_LEVER_MM = 100.0
"""Turns θ's column into a length before anything looks at singular values."""


class KinematicStatus(IntEnum):
    """Outcome of a kinematic solution."""

    FOUND = 0
    NONE = 1
    """The mechanism cannot be assembled there."""


class NoSolution(ValueError):
    """A pose or a set of joints at which the mechanism cannot be assembled."""


@dataclass(frozen=True, slots=True, eq=False)
class KinematicSolution:
    """Values (N, 4) and each row's outcome; rows without an assembly hold NaN.

    Whoever has not looked at the outcomes takes the values by `require`.
    """

    values: Array
    outcome: NDArray[np.uint8]

    @property
    def found(self) -> Mask:
        """Which rows hold an answer, (N,)."""
        return np.asarray(self.outcome == KinematicStatus.FOUND)

    def require(self) -> Array:
        """All values; raises `NoSolution` naming the first row that has none."""
        if not np.all(self.found):
            row = int(np.argmin(self.found))
            raise NoSolution(f"no assembly for row {row} of {len(self.outcome)}")
        return self.values


def arm_frames(geometry: Geometry) -> Array:
    """u_i, the motor's axis, and w_i, of unit length in the base frame, (3, 4, 3).

    The arm points along u_i at a joint angle of 0° (eq. 5) and along w_i at 90°. The axis is v_i of
    eq. 6 turned about u_i by the axis tilt; without one w_i points straight down.
    """
    cos, sin = np.cos(geometry.azimuth_rad), np.sin(geometry.azimuth_rad)
    level, tilt = np.cos(geometry.axis_tilt_rad), np.sin(geometry.axis_tilt_rad)
    outward = [cos, sin, np.zeros_like(cos)]
    axis = [-sin * level, cos * level, tilt]
    lowered = [-sin * tilt, cos * tilt, -level]
    return np.array([outward, axis, lowered]).transpose(0, 2, 1)


@dataclass(frozen=True, slots=True, eq=False)
class Arms:
    """A geometry's arms at joints, worked out once for whoever looks at the same postures.

    By component and arm: long rows are what the processor is fast at.
    """

    geometry: Geometry
    frames: Array
    """u_i, the motor's axis and w_i, (3, 4, 3)."""
    cos: Array
    """Of the joint angles, (4, N)."""
    sin: Array
    elbows_mm: Array
    """A_i in the base frame, (3, 4, N) (eq. 8); a positive angle lowers the elbow."""

    @classmethod
    def at(cls, geometry: Geometry, joints_rad: Array) -> "Arms":
        """At joints (N, 4) as the encoders read them."""
        angle = np.ascontiguousarray(joints_rad.T) + geometry.joint_offset_rad[:, None]
        frames, cos, sin = arm_frames(geometry), np.cos(angle), np.sin(angle)
        outward, _, lowered = (geometry.arm_mm * frames.swapaxes(1, 2))[..., None]
        elbows = geometry.motor_mm.T[..., None] + (cos * outward + sin * lowered)
        return cls(geometry, frames, cos, sin, elbows)

    def forearms_mm(self, poses: Array) -> Array:
        """A_iB'_i at poses (N, 4), (3, 4, N)."""
        return np.ascontiguousarray(plate_joints_mm(self.geometry, poses).T) - self.elbows_mm


def elbows_mm(geometry: Geometry, joints_rad: Array) -> Array:
    """A_i in the base frame, (N, 4, 3) (eq. 8)."""
    return Arms.at(geometry, joints_rad).elbows_mm.T


def in_arm_frames(frames: Array, vectors: Array) -> Array:
    """Vectors of the arms (N, 4, 3) along their frames' axes (3, 4, 3), as (3, N, 4)."""
    # a product of matrices for each arm; einsum takes ten times as long
    along = vectors.swapaxes(0, 1) @ frames.transpose(1, 2, 0)
    return np.ascontiguousarray(along.T)


def plate_joints_mm(geometry: Geometry, poses: Array) -> Array:
    """B'_i in the base frame, (N, 4, 3) (eq. 9)."""
    joints = np.repeat(poses[..., None, :3], 4, axis=-2)
    joints[..., 2:, 0] -= geometry.plate_mm * np.sin(poses[..., 3, None])
    joints[..., 2:, 1] += geometry.plate_mm * np.cos(poses[..., 3, None])
    return joints


def forearms_mm(geometry: Geometry, joints_rad: Array, poses: Array) -> Array:
    """A_iB'_i, (N, 4, 3)."""
    return Arms.at(geometry, joints_rad).forearms_mm(poses).T


def closure_mm2(geometry: Geometry, joints_rad: Array, poses: Array) -> Array:
    """|A_iB'_i|² - L_i², (N, 4); zero when assembled (eq. 3 with L_i for the printed l_i)."""
    forearms = forearms_mm(geometry, joints_rad, poses)
    return np.asarray(np.einsum("...k,...k->...", forearms, forearms) - geometry.forearm_mm**2)


def inverse(geometry: Geometry, poses: Array) -> KinematicSolution:
    """Encoder angles of poses, on the branch with the elbow outward (eqs. 10-14 as corrected)."""
    motor_to_plate = plate_joints_mm(geometry, poses) - geometry.motor_mm
    out, _, down = in_arm_frames(arm_frames(geometry), motor_to_plate)
    sine = -2.0 * geometry.arm_mm * down
    cosine = -2.0 * geometry.arm_mm * out
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
    return KinematicSolution(
        joints, np.where(found, KinematicStatus.FOUND, KinematicStatus.NONE).astype(np.uint8)
    )


def pose_jacobian(geometry: Geometry, joints_rad: Array, poses: Array) -> Array:
    """∂F/∂(X, Y, Z, θ) of the closures, (N, 4, 4), in mm (θ's column mm² per rad)."""
    return _by_pose(geometry, poses, forearms_mm(geometry, joints_rad, poses).T)


def closure_parameter_jacobian(geometry: Geometry, joints_rad: Array, poses: Array) -> Array:
    """∂F_i by arm i's own seven parameters, the plate's length and its axis's tilt, (N, 4, 9)."""
    arms = Arms.at(geometry, joints_rad)
    return _by_own_parameters(arms, poses, arms.forearms_mm(poses)).transpose(2, 0, 1)


def parameter_jacobian(geometry: Geometry, joints_rad: Array, poses: Array) -> Array:
    """d(X, Y, Z, θ)/dK at fixed joints, (N, 4, 33): implicit function theorem on the closures.

    K is in the order of `GEOMETRY_NAMES`. Raises `numpy.linalg.LinAlgError` at a singular pose.
    """
    return assembled_jacobian(Arms.at(geometry, joints_rad), poses)


def assembled_jacobian(arms: Arms, poses: Array) -> Array:
    """`parameter_jacobian` of arms and the poses (N, 4) that they hold the plate at."""
    forearms = arms.forearms_mm(poses)
    own = _by_own_parameters(arms, poses, forearms)
    inverses = np.linalg.inv(_by_pose(arms.geometry, poses, forearms))
    by_closure = -np.ascontiguousarray(inverses.transpose(1, 2, 0))
    by_all = np.empty((4, len(GEOMETRY_NAMES), len(poses)))
    # a parameter of one arm is in no other arm's closure
    by_arms = by_all[:, :PLATE].reshape(4, ARMS, len(ARM_FIELDS), len(poses))
    np.multiply(by_closure[:, :, None], own[:, : len(ARM_FIELDS)], out=by_arms)
    by_all[:, PLATE] = (by_closure * own[:, -2]).sum(axis=1)
    by_all[:, TILTS] = by_closure * own[:, -1]
    return by_all.transpose(2, 0, 1)


def _by_pose(geometry: Geometry, poses: Array, forearms: Array) -> Array:
    """∂F/∂(X, Y, Z, θ), (N, 4, 4), from forearms by component and arm, (3, 4, N)."""
    jacobian = np.zeros_like(forearms, shape=(len(poses), ARMS, 4))
    jacobian[:, :, :3] = 2.0 * forearms.T
    x, y, _ = forearms[:, 2:]
    sin, cos = np.sin(poses[:, 3]), np.cos(poses[:, 3])
    jacobian[:, 2:, 3] = -2.0 * geometry.plate_mm * (cos * x + sin * y).T
    return jacobian


def _by_own_parameters(arms: Arms, poses: Array, forearms: Array) -> Array:
    """∂F_i by arm i's parameters in the order of `ARM_FIELDS`, by h and by τ_i, (4, 9, N)."""
    geometry, cos, sin = arms.geometry, arms.cos, arms.sin
    out, aside, down = in_arm_frames(arms.frames, forearms.T).transpose(0, 2, 1)
    arm_mm, tilt_rad = geometry.arm_mm[:, None], geometry.axis_tilt_rad[:, None]
    across = np.cos(tilt_rad) * aside + np.sin(tilt_rad) * down
    jacobian = np.zeros_like(forearms, shape=(ARMS, len(ARM_FIELDS) + 2, len(poses)))
    jacobian[:, :3] = -2.0 * forearms.swapaxes(0, 1)
    jacobian[:, 3] = -2.0 * arm_mm * (cos * across - sin * np.sin(tilt_rad) * out)
    jacobian[:, 4] = 2.0 * arm_mm * (sin * out - cos * down)
    jacobian[:, 5] = -2.0 * (cos * out + sin * down)
    jacobian[:, 6] = -2.0 * geometry.forearm_mm[:, None]
    jacobian[:, 8] = -2.0 * arm_mm * sin * aside
    x, y, _ = forearms[:, 2:]
    jacobian[2:, 7] = 2.0 * (np.cos(poses[:, 3]) * y - np.sin(poses[:, 3]) * x)
    return jacobian
