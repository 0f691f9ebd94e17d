"""Feasibility of poses: margins of reach, limits, swing and singularity, and what they violate."""

from dataclasses import dataclass, replace
from enum import IntFlag

import numpy as np
from numpy.typing import ArrayLike, NDArray

from campaigns.arrays import Array, Index, Mask
from campaigns.kinematics.axes import Interval, outside
from campaigns.kinematics.mechanism import Margins, Mechanism

SINGULARITY_MARGIN = 0.2
"""Least singular value that `Margins.singular_value` may have, if a robot file gives none."""
ELBOW_MARGIN = 0.05
"""Smallest share of a forearm along which its joint moves it: below, the arm is stretched."""
LEAST_TURN_RAD = np.pi / 4
"""Turn that is searched each way, however narrow its limits are."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Motion limits of a robot, and its least distances from singular poses."""

    joint: Interval | tuple[tuple[float, ...], tuple[float, ...]]
    """Lowest and highest value of every joint, rad or mm; of unlike joints one for each, (n,)."""
    task: tuple[Interval | None, ...]
    """Limits of each task coordinate; None: only the workspace limits it."""
    forearm_swing_rad: float = 0.0
    """Largest swing of a forearm out of its arm's plane, or away from its rail; of none: 0."""
    singularity_margin: float = SINGULARITY_MARGIN
    elbow_margin: float = ELBOW_MARGIN

    def of_joints(self, count: int) -> list[Interval]:
        """Return the lowest and highest value of each of so many joints."""
        low, high = (np.broadcast_to(end, count).tolist() for end in self.joint)
        return list(zip(low, high, strict=True))

    @property
    def joint_range(self) -> Interval:
        """Lowest and highest value that any joint may have."""
        return float(np.min(self.joint[0])), float(np.max(self.joint[1]))

    def narrowed_by(
        self, *, joint: ArrayLike = 0.0, task: ArrayLike = 0.0, swing_rad: float = 0.0
    ) -> "Limits":
        """Return limits narrower by these amounts at each end; negative amounts widen them.

        `joint` is one amount for all joints or one for each, (n,), `task` one for each axis, (t,).
        """
        ends = np.array([np.add(self.joint[0], joint), np.subtract(self.joint[1], joint)])
        low, high = ends.tolist()
        amounts = np.broadcast_to(task, len(self.task)).tolist()
        return replace(
            self,
            joint=(low, high) if ends.ndim == 1 else (tuple(low), tuple(high)),
            task=tuple(
                interval and _narrowed(interval, by)
                for interval, by in zip(self.task, amounts, strict=True)
            ),
            forearm_swing_rad=self.forearm_swing_rad - swing_rad,
        )


def _narrowed(interval: Interval, by: float) -> Interval:
    """Return an interval narrower by an amount at each end; that of a fixed axis stays."""
    low, high = interval
    return interval if low == high else (low + by, high - by)


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

    mechanism: Mechanism
    limits: Limits
    poses: Array
    """(N, t)"""
    joints: Array
    """(N, n)"""
    margins: Margins
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
        swing_from, end = self.mechanism.words_of_swing
        if Violation.OUT_OF_REACH in violated:
            return [self.mechanism.out_of_reach]
        axes, values = self.mechanism.joints, self.joints[row]
        joints = zip(axes, values, limits.of_joints(len(axes)), strict=True)
        words = [
            f"joint {number} at {axis.text(value, '.3f')} outside {axis.span(interval)}"
            for number, (axis, value, interval) in enumerate(joints)
            if outside(value, interval)
        ]
        if Violation.TASK_LIMIT in violated:
            columns = zip(self.mechanism.task, self.poses[row], limits.task, strict=True)
            words += [
                f"{axis.name} {axis.text(value, '.3f')} outside {axis.span(interval)}"
                for axis, value, interval in columns
                if interval is not None and outside(value, interval)
            ]
        words += [
            f"forearm {number} swings {np.degrees(swing):.2f}° {swing_from}, limit "
            f"{np.degrees(limits.forearm_swing_rad):g}°"
            for number, swing in enumerate(self.margins.swing_rad[row])
            if abs(swing) > limits.forearm_swing_rad
        ]
        if Violation.ABOVE_ELBOWS in violated:
            words.append(f"another assembly: the platform would be above its {end}s")
        elif Violation.OTHER_ASSEMBLY in violated:
            words.append("another assembly: from home these joints lead to another pose")
        if Violation.SINGULAR in violated:
            margins = self.margins
            near = (
                f"too near a singularity: margin {margins.singular_value[row]:.3f} "
                f"(limit {limits.singularity_margin:g})"
            )
            if self.mechanism.has_forearms:
                near += f", {end} {margins.elbow[row]:.3f} (limit {limits.elbow_margin:g})"
            words.append(near)
        return words


def feasibility(mechanism: Mechanism, p: Array, limits: Limits, poses: Array) -> Feasibility:
    """Judge poses (N, t) by reach, assembly mode, limits, swing and distance from singularities."""
    joints, is_solved = mechanism.inverse(p, poses)
    margins = path_feasibility(mechanism, p, limits, (joints, poses))
    is_beyond = outside(joints, limits.joint).any(axis=1)
    violations = (
        margins.violations
        | ~is_solved * int(Violation.OUT_OF_REACH)
        | is_beyond * int(Violation.JOINT_LIMIT)
    )
    # Joints of another assembly mode would bring the robot to another pose than the one judged.
    # Poses of ways need no such check: they are solved in the mode of home.
    rows = np.flatnonzero(violations == Violation.NONE)
    is_elsewhere = ~mechanism.is_mode_of_home(p, joints[rows], poses[rows])
    violations[rows[is_elsewhere]] = Violation.OTHER_ASSEMBLY
    return replace(margins, violations=violations.astype(np.uint8))


# Each limit is a column of excesses: 0 at the limit, positive beyond it. Rows out of reach are NaN,
# which is beyond none.
def path_feasibility(
    mechanism: Mechanism,
    p: Array,
    limits: Limits,
    passed: tuple[Array, Array],
    starts: Index | None = None,
) -> Feasibility:
    """Judge known joints (N, n) and their poses (N, t) without limits of joints.

    `starts` (N,) are the rows at which each one's way begins. A way that begins beyond a limit
    violates it where it goes further beyond than it was there: a robot that stands there can leave.
    """
    joints, poses = passed
    margins = mechanism.margins(p, joints, poses)
    swing = np.abs(margins.swing_rad) - limits.forearm_swing_rad
    excess = {
        Violation.TASK_LIMIT: _beyond_task(poses, limits),
        Violation.ABOVE_ELBOWS: margins.is_above[:, None].astype(float),
        Violation.SWING_LIMIT: swing,
        Violation.SINGULAR: np.column_stack(
            [
                limits.singularity_margin - margins.singular_value,
                limits.elbow_margin - margins.elbow,
            ]
        ),
    }
    violations = np.zeros(len(poses), dtype=np.uint8)
    for violation, beyond in excess.items():
        allowed = 0.0 if starts is None else np.maximum(beyond[starts], 0.0)
        violations |= (beyond > allowed).any(axis=1) * np.uint8(violation)
    return Feasibility(mechanism, limits, poses, joints, margins, violations)


def _beyond_task(poses: Array, limits: Limits) -> Array:
    """Return how far poses (N, t) are beyond both ends of each limit of the task, (N, 2 L)."""
    columns = [
        beyond
        for value, interval in zip(poses.T, limits.task, strict=True)
        if interval is not None
        for beyond in (interval[0] - value, value - interval[1])
    ]
    return np.stack(columns, axis=1) if columns else np.empty((len(poses), 0))


# Poses are drawn from this box and rejected outside of the reach, so it may be too large but not
# too small.
def search_extent(mechanism: Mechanism, p: Array, limits: Limits, centre: Array) -> Array:
    """Return the half size (t,) of a box about a pose that holds all that the robot reaches."""
    half = np.full(len(mechanism.task), LEAST_TURN_RAD)
    for place, interval in enumerate(limits.task[3:], 3):
        if interval is not None:
            half[place] = max(0.5 * (interval[1] - interval[0]), LEAST_TURN_RAD)
    low, high = mechanism.reach_mm(p, limits.joint_range, limits.forearm_swing_rad)
    reach = np.maximum(np.maximum(high - centre[:3], centre[:3] - low), 0.0)
    half[:3] = reach + mechanism.reach_of_turns_mm(p) * half[3:].sum()
    for place, interval in enumerate(limits.task[:3]):
        if interval is not None:
            half[place] = max(interval[1] - centre[place], centre[place] - interval[0])
    return half


def platform_radius_mm(mechanism: Mechanism, p: Array, limits: Limits) -> float:
    """Return the distance of the farthest lower end from the measured point at any turn."""
    turns = np.zeros((33, 1))
    if len(mechanism.task) > 3 and (interval := limits.task[3]) is not None:
        turns[:, 0] = np.linspace(*interval, len(turns))
    return mechanism.radius_mm(p, turns)
