"""Feasibility of poses: margins of reach, limits, swing and singularity, and what they violate."""

from dataclasses import dataclass, replace
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from campaigns.arrays import Array, Mask
from campaigns.kinematics.axes import Interval, outside
from campaigns.kinematics.closed_chain import ClosedChain

SINGULARITY_MARGIN = 0.2
"""Least singular value that `ClosedChain.singular_values` may have, if a robot file gives none."""
ELBOW_MARGIN = 0.05
"""Smallest share of a forearm along which its joint moves it: below, the arm is stretched."""
LEAST_TURN_RAD = np.pi / 4
"""Turn that is searched each way, however narrow its limits are."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Motion limits of a robot, and its least distances from singular poses."""

    joint: Interval
    """Limits of every joint, rad or mm."""
    task: tuple[Interval | None, ...]
    """Limits of each task coordinate; None: only the workspace limits it."""
    forearm_swing_rad: float
    """Largest swing of a forearm out of its arm's plane, or away from its rail."""
    singularity_margin: float = SINGULARITY_MARGIN
    elbow_margin: float = ELBOW_MARGIN

    def narrowed_by(
        self, *, joint: float = 0.0, task: float = 0.0, swing_rad: float = 0.0
    ) -> "Limits":
        """Return limits narrower by these amounts at each end; negative amounts widen them."""
        low, high = self.joint
        return replace(
            self,
            joint=(low + joint, high - joint),
            task=tuple(ends and (ends[0] + task, ends[1] - task) for ends in self.task),
            forearm_swing_rad=self.forearm_swing_rad - swing_rad,
        )


class Violation(IntFlag):
    """Reason why a pose cannot be taken; several may hold at once."""

    NONE = 0
    OUT_OF_REACH = 1
    JOINT_LIMIT = 2
    TASK_LIMIT = 4
    SWING_LIMIT = 8
    SINGULAR = 16
    ABOVE_ELBOWS = 32
    OTHER_ASSEMBLY = 64


@dataclass(frozen=True, slots=True, eq=False)
class Feasibility:
    """Margins of poses, and the limits that poses violate. Rows out of reach hold NaN margins."""

    chain: ClosedChain
    limits: Limits
    poses: Array
    """(N, t)"""
    joints: Array
    """(N, n)"""
    swing_rad: Array
    """Angle of each forearm out of its arm's plane, or away from its rail, (N, n)."""
    singular_value: Array
    """Smallest singular value of the closures' Jacobian, as for `SINGULARITY_MARGIN`, (N,)."""
    elbow: Array
    """Smallest share of a forearm along which its joint moves it, (N,)."""
    violations: NDArray[np.uint8]
    """`Violation` flags, (N,); zero if the pose can be taken."""

    @property
    def feasible(self) -> Mask:
        """Poses that can be taken, (N,)."""
        return np.asarray(self.violations == Violation.NONE)

    def describe(self, row: int, limits: Limits | None = None) -> list[str]:
        """Name the violations of one pose in words, each with its value and limit.

        `limits` are the limits to name, where wider ones were tested; None: the tested ones.
        """
        limits = limits or self.limits
        # a pose out of reach has no joints and margins to judge, so this reason stands alone
        violated = Violation(int(self.violations[row]))
        joint_place, swing_from, end = self.chain.limb.words
        if Violation.OUT_OF_REACH in violated:
            return [f"out of reach: a forearm cannot span from {joint_place} to the plate"]
        words = [
            f"joint {number} at {axis.text(value, '.3f')} outside {axis.span(limits.joint)}"
            for number, (axis, value) in enumerate(
                zip(self.chain.joints, self.joints[row], strict=True)
            )
            if outside(value, limits.joint)
        ]
        if Violation.TASK_LIMIT in violated:
            columns = zip(self.chain.task, self.poses[row], limits.task, strict=True)
            words += [
                f"{axis.name} {axis.text(value, '.3f')} outside {axis.span(interval)}"
                for axis, value, interval in columns
                if interval is not None and outside(value, interval)
            ]
        words += [
            f"forearm {number} swings {np.degrees(swing):.2f}° {swing_from}, limit "
            f"{np.degrees(limits.forearm_swing_rad):g}°"
            for number, swing in enumerate(self.swing_rad[row])
            if abs(swing) > limits.forearm_swing_rad
        ]
        if Violation.ABOVE_ELBOWS in violated:
            words.append(f"another assembly: the platform would be above its {end}s")
        elif Violation.OTHER_ASSEMBLY in violated:
            words.append("another assembly: from home these joints lead to another pose")
        if Violation.SINGULAR in violated:
            words.append(
                f"too near a singularity: margin {self.singular_value[row]:.3f} "
                f"(limit {limits.singularity_margin:g}), "
                f"{end} {self.elbow[row]:.3f} (limit {limits.elbow_margin:g})"
            )
        return words


def feasibility(chain: ClosedChain, p: Array, limits: Limits, poses: Array) -> Feasibility:
    """Judge poses (N, t) by reach, assembly mode, limits, swing and distance from singularities."""
    joints, is_solved = chain.inverse(p, poses)
    margins = path_feasibility(chain, p, limits, joints, poses)
    is_beyond = outside(joints, limits.joint).any(axis=1)
    violations = (
        margins.violations
        | ~is_solved * int(Violation.OUT_OF_REACH)
        | is_beyond * int(Violation.JOINT_LIMIT)
    )
    # Joints of another assembly mode would bring the robot to another pose than the one judged.
    # Poses of ways need no such check: they are solved in the mode of home.
    rows = np.flatnonzero(violations == Violation.NONE)
    is_elsewhere = ~chain.is_mode_of_home(p, joints[rows], poses[rows])
    violations[rows[is_elsewhere]] = Violation.OTHER_ASSEMBLY
    return replace(margins, violations=violations.astype(np.uint8))


# Margins are those of a level plate at the joints' true angles: tilts of milliradians change
# none of them noticeably. Rows out of reach are NaN, which violates none of these limits.
def path_feasibility(
    chain: ClosedChain, p: Array, limits: Limits, joints: Array, poses: Array
) -> Feasibility:
    """Judge poses (N, t) passed at known joints (N, n), whose limits do not count."""
    geometry = chain.geometry(p)
    true = chain.true_joints(geometry, joints)
    upper_ends = chain.limb.upper_ends(geometry.arms, true)
    forearms = chain.lower_ends(geometry, poses) - upper_ends
    swing_rad = chain.limb.swing_rad(geometry.arms, forearms)
    elbow = chain.limb.leverage(geometry.arms, true, forearms).min(axis=1)
    has_joints = np.isfinite(joints).all(axis=1)  # singular values of NaN would raise
    singular_value = np.full(len(poses), np.nan)
    singular_value[has_joints] = chain.singular_values(
        geometry, upper_ends[:, has_joints], poses[has_joints]
    )
    is_beyond = np.zeros(len(poses), dtype=bool)
    for column, interval in zip(poses.T, limits.task, strict=True):
        if interval is not None:
            is_beyond |= outside(column, interval)
    is_singular = (singular_value < limits.singularity_margin) | (elbow < limits.elbow_margin)
    is_above = poses[:, 2] >= upper_ends[2].mean(axis=-1)
    swings_too_far = (np.abs(swing_rad) > limits.forearm_swing_rad).any(axis=1)
    violations = (
        is_beyond * int(Violation.TASK_LIMIT)
        | is_above * int(Violation.ABOVE_ELBOWS)
        | swings_too_far * int(Violation.SWING_LIMIT)
        | is_singular * int(Violation.SINGULAR)
    )
    return Feasibility(
        chain, limits, poses, joints, swing_rad, singular_value, elbow, violations.astype(np.uint8)
    )


# Poses are drawn from this box and rejected outside of the reach, so it may be too large but not
# too small. The reach of the forearms holds the lower ends; the controlled point of sliding bars is
# farther out by pinion times turn.
def search_extent(chain: ClosedChain, p: Array, limits: Limits, centre: Array) -> Array:
    """Return the half size (t,) of a box about a pose that holds all that the robot reaches."""
    geometry = chain.geometry(p)
    half = np.full(len(chain.task), LEAST_TURN_RAD)
    for place, interval in enumerate(limits.task[3:], 3):
        if interval is not None:
            half[place] = max(0.5 * (interval[1] - interval[0]), LEAST_TURN_RAD)
    low, high = chain.limb.reach_mm(geometry.arms, limits.joint, limits.forearm_swing_rad)
    pinion_mm = float(geometry.length[0, 0]) if chain.platform.bars_along_x else 0.0
    reach = np.maximum(np.maximum(high - centre[:3], centre[:3] - low), 0.0)
    half[:3] = reach + pinion_mm * half[3:].sum()
    for place, interval in enumerate(limits.task[:3]):
        if interval is not None:
            half[place] = 0.5 * (interval[1] - interval[0])
    return half


def platform_radius_mm(chain: ClosedChain, p: Array, limits: Limits) -> float:
    """Return the distance of the farthest lower end from the measured point at any turn."""
    turns = np.zeros((33, 1))
    if len(chain.task) > 3 and limits.task[3] is not None:
        turns[:, 0] = np.linspace(*limits.task[3], len(turns))
    lower_ends = chain.platform.offsets(chain.geometry(p).length, turns)
    return float(np.linalg.norm(lower_ends, axis=0).max())
