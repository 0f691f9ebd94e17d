"""Which poses a robot can take, and every reason why not."""

from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from campaigns.arrays import Array, Mask
from campaigns.mechanisms.geometry import Geometry
from campaigns.mechanisms.par4 import (
    PLATE_LEVER_MM,
    arm_frames,
    forearms_mm,
    in_arm_frames,
    inverse,
    pose_jacobian,
)

SINGULARITY_MARGIN = 0.2
"""Least singular value of the closures' unit rows, θ's column divided by 100 mm."""
ELBOW_MARGIN = 0.05
"""Least sine of the angle between arm and forearm in the arm's plane: below, it is stretched."""


class Violation(IntFlag):
    """Why a pose cannot be taken; several may hold at once."""

    NONE = 0
    OUT_OF_REACH = 1
    JOINT_LIMIT = 2
    THETA_LIMIT = 4
    SWING_LIMIT = 8
    SINGULAR = 16


@dataclass(frozen=True, slots=True)
class Limits:
    """What a robot may do."""

    joint_rad: tuple[float, float]
    theta_rad: tuple[float, float]
    forearm_swing_rad: float
    singularity_margin: float = SINGULARITY_MARGIN
    elbow_margin: float = ELBOW_MARGIN


@dataclass(frozen=True, slots=True, eq=False)
class Feasibility:
    """The measures that decide, and the decision. Rows out of reach hold NaN in every measure."""

    joints_rad: Array
    """(N, 4)"""
    swing_rad: Array
    """Each forearm's angle out of its arm's plane, (N, 4)."""
    singular_value: Array
    """(N,)"""
    elbow_sine: Array
    """Of the elbow nearest to being stretched, (N,)."""
    reasons: NDArray[np.uint8]
    """`Violation` flags, (N,); zero when the pose can be taken."""

    @property
    def feasible(self) -> Mask:
        """Which poses can be taken, (N,)."""
        return np.asarray(self.reasons == Violation.NONE)


def feasibility(geometry: Geometry, limits: Limits, poses: Array) -> Feasibility:
    """Judge poses (N, 4) by reach, joint limits, θ, forearm swing and distance from singularity."""
    solution = inverse(geometry, poses)
    joints, found = solution.values, solution.found
    forearms = forearms_mm(geometry, joints, poses)
    swing = swing_rad(geometry, forearms)
    elbow = _elbow_sine(geometry, joints, forearms)
    singular = np.full(len(poses), np.nan)
    singular[found] = smallest_singular_value(geometry, joints[found], poses[found])
    too_near = (singular < limits.singularity_margin) | (elbow < limits.elbow_margin)
    reasons = (
        ~found * int(Violation.OUT_OF_REACH)
        | outside(joints, limits.joint_rad).any(axis=1) * int(Violation.JOINT_LIMIT)
        | outside(poses[:, 3], limits.theta_rad) * int(Violation.THETA_LIMIT)
        | (np.abs(swing) > limits.forearm_swing_rad).any(axis=1) * int(Violation.SWING_LIMIT)
        | too_near * int(Violation.SINGULAR)
    )
    return Feasibility(joints, swing, singular, elbow, reasons.astype(np.uint8))


def swing_rad(geometry: Geometry, forearms: Array) -> Array:
    """Angles of forearms (N, 4, 3) out of their arms' planes, (N, 4)."""
    _, aside, _ = in_arm_frames(arm_frames(geometry), forearms)
    sine = aside / geometry.forearm_mm
    return np.asarray(np.arcsin(np.clip(sine, -1.0, 1.0)))


def smallest_singular_value(geometry: Geometry, joints_rad: Array, poses: Array) -> Array:
    """Of the closures' Jacobian with rows of unit length and θ's column divided by 100 mm, (N,)."""
    jacobian = pose_jacobian(geometry, joints_rad, poses)
    jacobian[..., 3] /= PLATE_LEVER_MM
    jacobian /= np.linalg.norm(jacobian, axis=-1, keepdims=True)
    return np.asarray(np.linalg.svd(jacobian, compute_uv=False)[..., -1])


def describe_violations(
    limits: Limits, judged: Feasibility, row: int, theta_rad: float
) -> list[str]:
    """Every reason against one pose, each with its value and limit, in degrees."""
    reasons = Violation(int(judged.reasons[row]))
    if Violation.OUT_OF_REACH in reasons:
        return ["out of reach: a forearm cannot span from its elbow's circle to the plate"]
    found = [
        f"joint {i} at {np.degrees(q):.3f}° outside {_span(limits.joint_rad)}"
        for i, q in enumerate(judged.joints_rad[row])
        if outside(q, limits.joint_rad)
    ]
    if Violation.THETA_LIMIT in reasons:
        found.append(f"theta {np.degrees(theta_rad):.3f}° outside {_span(limits.theta_rad)}")
    found += [
        f"forearm {i} swings {np.degrees(swing):.2f}° out of its arm's plane, limit "
        f"{np.degrees(limits.forearm_swing_rad):g}°"
        for i, swing in enumerate(judged.swing_rad[row])
        if abs(swing) > limits.forearm_swing_rad
    ]
    if Violation.SINGULAR in reasons:
        found.append(
            f"too near a singularity: margin {judged.singular_value[row]:.3f} "
            f"(limit {limits.singularity_margin:g}), "
            f"elbow {judged.elbow_sine[row]:.3f} (limit {limits.elbow_margin:g})"
        )
    return found


def outside(values: Array, interval: tuple[float, float]) -> Mask:
    """Which values leave an interval; NaN does not."""
    return np.asarray((values < interval[0]) | (values > interval[1]))


def _elbow_sine(geometry: Geometry, joints_rad: Array, forearms: Array) -> Array:
    """|∂F/∂q| / 2lL of the arm where it is least, (N,)."""
    angle = joints_rad + geometry.joint_offset_rad
    out, _, down = in_arm_frames(arm_frames(geometry), forearms)
    lever = np.cos(angle) * down - np.sin(angle) * out
    return np.asarray(np.abs(lever / geometry.forearm_mm).min(axis=1))


def _span(interval_rad: tuple[float, float]) -> str:
    return f"[{np.degrees(interval_rad[0]):g}°, {np.degrees(interval_rad[1]):g}°]"
