"""Whether the way between two poses is safe, and a way round when it is not."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from campaigns.numerics.forward import forward
from campaigns.numerics.geometry import Array, Geometry
from campaigns.numerics.par4 import forearms_mm, inverse, motor_axes
from campaigns.numerics.reach import Limits, least_singular_value

PATH_STEP_RAD = np.radians(5.0)
SLACK_RAD = np.radians(3.0)
"""A passing pose may exceed θ's and the forearms' limits by this; a pose that is measured may not."""
PASSING_SINGULARITY_MARGIN = 0.1


@dataclass(frozen=True, slots=True)
class PathFault:
    """Why a joint move is not safe."""

    reason: str
    part_of_the_way: float


def path_fault(
    geometry: Geometry, limits: Limits, from_rad: Array, to_rad: Array
) -> PathFault | None:
    """What first goes wrong on the coordinated joint move between two sets of joints (4,), if anything."""
    steps = max(2, int(np.ceil(np.abs(to_rad - from_rad).max() / PATH_STEP_RAD)) + 1)
    part = np.linspace(0.0, 1.0, steps)
    joints = from_rad + part[:, None] * (to_rad - from_rad)
    solution = forward(geometry, joints)
    if not solution.found.all():
        return PathFault(
            "the mechanism cannot be assembled", float(part[np.argmin(solution.found)])
        )
    poses = solution.values
    forearms = forearms_mm(geometry, joints, poses)
    swing = np.abs(
        np.arcsin(np.einsum("nik,ik->ni", forearms, motor_axes(geometry)) / geometry.forearm_mm)
    )
    theta = poses[:, 3]
    checks = (
        (
            "theta leaves its limits",
            (theta < limits.theta_rad[0] - SLACK_RAD) | (theta > limits.theta_rad[1] + SLACK_RAD),
        ),
        ("a forearm swings too far", (swing > limits.forearm_swing_rad + SLACK_RAD).any(axis=1)),
        (
            "it passes near a singularity",
            least_singular_value(geometry, joints, poses) < PASSING_SINGULARITY_MARGIN,
        ),
    )
    for reason, wrong in checks:
        if wrong.any():
            return PathFault(reason, float(part[np.argmax(wrong)]))
    return None


def route(
    geometry: Geometry, limits: Limits, from_rad: Array, to_rad: Array, centre: Array
) -> list[Array] | None:
    """Joint targets (4,) of a safe way, the last being `to_rad`; None when none was found.

    Straight if that is safe, else by poses between the two ends and the workspace's centre (4,).
    """
    if path_fault(geometry, limits, from_rad, to_rad) is None:
        return [to_rad]
    ends = forward(geometry, np.stack([from_rad, to_rad]))
    if not ends.found.all():
        return None
    for poses in _detours(*ends.values, centre):
        via = inverse(geometry, poses)
        way = [from_rad, *via.values, to_rad]
        if via.found.all() and all(
            path_fault(geometry, limits, a, b) is None for a, b in zip(way, way[1:], strict=False)
        ):
            return way[1:]
    return None


def _detours(from_pose: Array, to_pose: Array, centre: Array) -> Iterator[Array]:
    """Poses to pass by, (K, 4), from the shortest detour to the longest."""
    middle = 0.5 * (from_pose + to_pose)
    for pull in (0.0, 0.3, 0.6, 1.0):
        yield (middle + pull * (centre - middle))[None]
    for pull in (0.3, 0.6):
        inner = [end + pull * (centre - end) for end in (from_pose, to_pose)]
        yield np.stack([inner[0], inner[1]])
        yield np.stack([inner[0], centre, inner[1]])
