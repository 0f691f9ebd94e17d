"""Feasibility of poses: margins of reach, limits, swing and singularity, and what they violate."""

from dataclasses import dataclass, replace
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from campaigns.arrays import Array, Mask
from campaigns.kinematics.axes import Interval, outside
from campaigns.kinematics.closed_chain import ClosedChain

SINGULARITY_MARGIN = 0.2
"""Smallest singular value of the closures' unit rows, columns of angles divided by a lever."""
ELBOW_MARGIN = 0.05
"""Smallest share of a forearm along which its joint moves it: below, the arm is stretched."""
LEAST_TURN_RAD = np.pi / 4
"""Turn that is searched each way, however narrow its limits are."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Motion limits of a robot, and how near it may come to what it cannot do."""

    joint: Interval
    """Limits of every joint, rad or mm."""
    task: tuple[Interval | None, ...]
    """Limits of each task coordinate; None: only the workspace limits it."""
    forearm_swing_rad: float
    singularity_margin: float = SINGULARITY_MARGIN
    elbow_margin: float = ELBOW_MARGIN

    def narrowed_by(
        self, *, joint: float = 0.0, task: float = 0.0, swing_rad: float = 0.0
    ) -> "Limits":
        """Return limits narrower by some amounts at each end; negative amounts widen them."""
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


@dataclass(frozen=True, slots=True, eq=False)
class Feasibility:
    """Margins of poses, and what they violate. Rows out of reach hold NaN in every margin."""

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

        `limits` are those to be named, if others were tested.
        """
        limits = limits or self.limits
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
        if Violation.SINGULAR in violated:
            words.append(
                f"too near a singularity: margin {self.singular_value[row]:.3f} "
                f"(limit {limits.singularity_margin:g}), "
                f"{end} {self.elbow[row]:.3f} (limit {limits.elbow_margin:g})"
            )
        return words


def feasibility(chain: ClosedChain, p: Array, limits: Limits, poses: Array) -> Feasibility:
    """Judge poses (N, t) by reach, limits, forearm swing and distance from singularities."""
    joints, is_solved = chain.inverse(p, poses)
    margins = path_feasibility(chain, p, limits, joints, poses)
    beyond = outside(joints, limits.joint).any(axis=1) * int(Violation.JOINT_LIMIT)
    violations = margins.violations | ~is_solved * int(Violation.OUT_OF_REACH) | beyond
    return replace(margins, violations=violations.astype(np.uint8))


def path_feasibility(
    chain: ClosedChain, p: Array, limits: Limits, joints: Array, poses: Array
) -> Feasibility:
    """Judge poses (N, t) passed at known joints (N, n), whose limits do not count.

    Margins are of a level plate: tilts of milliradians change none that counts.
    """
    geometry = chain.geometry(p)
    true = chain.true_joints(geometry, joints)
    ends = chain.limb.upper_ends(geometry.arms, true)
    forearms = chain.lower_ends(geometry, poses) - ends
    swing_rad = chain.limb.swing_rad(geometry.arms, forearms)
    elbow = chain.limb.leverage(geometry.arms, true, forearms).min(axis=1)
    rows = np.isfinite(joints).all(axis=1)
    singular_value = np.full(len(poses), np.nan)
    singular_value[rows] = chain.singular_values(geometry, ends[:, rows], poses[rows])
    beyond = np.zeros(len(poses), dtype=bool)
    for column, interval in zip(poses.T, limits.task, strict=True):
        if interval is not None:
            beyond |= outside(column, interval)
    too_near = (singular_value < limits.singularity_margin) | (elbow < limits.elbow_margin)
    violations = (
        beyond * int(Violation.TASK_LIMIT)
        | (poses[:, 2] >= ends[2].mean(axis=-1)) * int(Violation.ABOVE_ELBOWS)
        | (np.abs(swing_rad) > limits.forearm_swing_rad).any(axis=1) * int(Violation.SWING_LIMIT)
        | too_near * int(Violation.SINGULAR)
    )
    return Feasibility(
        chain, limits, poses, joints, swing_rad, singular_value, elbow, violations.astype(np.uint8)
    )


def search_extent(chain: ClosedChain, p: Array, limits: Limits, centre: Array) -> Array:
    """Return the half size (t,) of a box about a pose that holds all that the robot reaches."""
    geometry = chain.geometry(p)
    half = np.full(len(chain.task), LEAST_TURN_RAD)
    for place, interval in enumerate(limits.task[3:], 3):
        if interval is not None:
            half[place] = max(0.5 * (interval[1] - interval[0]), LEAST_TURN_RAD)
    low, high = chain.limb.reach_mm(geometry.arms, limits.joint, limits.forearm_swing_rad)
    aside = float(geometry.length[0, 0]) if chain.platform.bars_along_x else 0.0
    reach = np.maximum(np.maximum(high - centre[:3], centre[:3] - low), 0.0)
    half[:3] = reach + aside * half[3:].sum()
    for place, interval in enumerate(limits.task[:3]):
        if interval is not None:
            half[place] = 0.5 * (interval[1] - interval[0])
    return half


def platform_radius_mm(chain: ClosedChain, p: Array, limits: Limits) -> float:
    """Return the distance of the farthest lower end from the measured point at any turn."""
    turns = np.zeros((33, 1))
    if len(chain.task) > 3 and limits.task[3] is not None:
        turns[:, 0] = np.linspace(*limits.task[3], len(turns))
    ends = chain.platform.offsets(chain.geometry(p).length, turns)
    return float(np.linalg.norm(ends, axis=0).max())
