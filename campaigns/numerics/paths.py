"""Whether the way between two poses is safe, and a way round when it is not."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from campaigns.numerics.forward import forward
from campaigns.numerics.geometry import Array, Geometry, Mask
from campaigns.numerics.par4 import forearms_mm, inverse
from campaigns.numerics.reach import Limits, least_singular_value, outside, swing_rad

PATH_STEP_RAD = np.radians(5.0)
SLACK_RAD = np.radians(3.0)
"""A passing pose may exceed θ's and the forearms' limits by this; one that is measured may not."""
PASSING_SINGULARITY_MARGIN = 0.1


@dataclass(frozen=True, slots=True)
class PathFault:
    """Why a joint move is not safe."""

    reason: str
    part_of_the_way: float


def path_fault(
    geometry: Geometry, limits: Limits, from_rad: Array, to_rad: Array
) -> PathFault | None:
    """What goes wrong on the coordinated move from joints to joints, (4,) each, if anything."""
    steps = max(2, int(np.ceil(np.abs(to_rad - from_rad).max() / PATH_STEP_RAD)) + 1)
    part = np.linspace(0.0, 1.0, steps)
    joints = from_rad + part[:, None] * (to_rad - from_rad)
    solution = forward(geometry, joints)
    if not solution.found.all():
        lost = float(part[np.argmin(solution.found)])
        return PathFault("the mechanism cannot be assembled", lost)
    for reason, wrong in _passing_faults(geometry, limits, joints, solution.values):
        if wrong.any():
            return PathFault(reason, float(part[np.argmax(wrong)]))
    return None


def _passing_faults(
    geometry: Geometry, limits: Limits, joints: Array, poses: Array
) -> Iterator[tuple[str, Mask]]:
    """What a passing pose may not do, and which of the poses (N, 4) do it, (N,)."""
    theta, (low, high) = poses[:, 3], limits.theta_rad
    yield "theta leaves its limits", (theta < low - SLACK_RAD) | (theta > high + SLACK_RAD)
    swing = np.abs(swing_rad(geometry, forearms_mm(geometry, joints, poses)))
    too_far = (swing > limits.forearm_swing_rad + SLACK_RAD).any(axis=1)
    yield "a forearm swings too far", np.asarray(too_far)
    margin = least_singular_value(geometry, joints, poses)
    yield "it passes near a singularity", margin < PASSING_SINGULARITY_MARGIN


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
    for poses in _detours(ends.values[0], ends.values[1], centre):
        via = inverse(geometry, poses)
        way = [from_rad, *via.values, to_rad]
        within = not outside(via.values, limits.joint_rad).any()
        if via.found.all() and within and _is_safe(geometry, limits, way):
            return way[1:]
    return None


def _is_safe(geometry: Geometry, limits: Limits, way: list[Array]) -> bool:
    return all(path_fault(geometry, limits, here, there) is None for here, there in pairwise(way))


def _detours(from_pose: Array, to_pose: Array, centre: Array) -> Iterator[Array]:
    """Poses to pass by, (K, 4), from the shortest detour to the longest."""
    middle = 0.5 * (from_pose + to_pose)
    for pull in (0.0, 0.3, 0.6, 1.0):
        yield (middle + pull * (centre - middle))[None]
    for pull in (0.3, 0.6):
        inner = [end + pull * (centre - end) for end in (from_pose, to_pose)]
        yield np.stack([inner[0], inner[1]])
        yield np.stack([inner[0], centre, inner[1]])
