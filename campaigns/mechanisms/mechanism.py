"""Mechanism interface: axes, named parameters, kinematic solutions and feasibility.

A mechanism has no state; every robot of its kind is a parameter vector p, (G,), in mm and rad.
Joints (N, n) and poses (N, t) are batches in inner units, one column an axis: rad for revolute
axes, mm for prismatic ones. Files and screens say deg and mm.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntFlag
from functools import cached_property
from typing import TYPE_CHECKING, Literal, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from campaigns.arrays import Array, Mask, batch
from campaigns.mechanisms.parameters import Parameters

if TYPE_CHECKING:
    from campaigns.mechanisms.closed_chain import ClosedChain

Interval = tuple[float, float]

SINGULARITY_MARGIN = 0.2
"""Smallest singular value of the closures' unit rows, columns of angles divided by a lever."""
ELBOW_MARGIN = 0.05
"""Smallest share of a forearm along which its joint moves it: below, the arm is stretched."""
MM_PER_RAD = 300.0
"""Length of a typical crank, by which a carriage's travel compares with a crank's turn."""


@dataclass(frozen=True)
class Axis:
    """Joint or task coordinate by name: revolute (rad inside, deg in files) or prismatic (mm)."""

    name: str
    kind: Literal["revolute", "prismatic"]

    @cached_property  # asked of for each number of a plan
    def is_revolute(self) -> bool:
        """Whether its values are angles."""
        return self.kind == "revolute"

    @property
    def unit(self) -> str:
        """Unit in files and on screens."""
        return "deg" if self.is_revolute else "mm"

    @cached_property
    def column(self) -> str:
        """Name in files, with the unit: `q0_deg`."""
        return f"{self.name}_{self.unit}"

    @property
    def scale(self) -> float:
        """Inner units that compare with one radian of a crank."""
        return 1.0 if self.is_revolute else MM_PER_RAD

    def to_file(self, value: float) -> float:
        """Value in the unit of files."""
        return math.degrees(value) if self.is_revolute else value

    def from_file(self, value: float) -> float:
        """Inner value of one in the unit of files."""
        return math.radians(value) if self.is_revolute else value

    def text(self, value: float, form: str) -> str:
        """Value for people: `12.345°` or `12.345 mm`, by a format such as `.3f`."""
        return f"{self.to_file(value):{form}}{'°' if self.is_revolute else ' mm'}"

    def span(self, interval: Interval) -> str:
        """Interval for people: `[-45°, 90°]`."""
        low, high = (self.text(end, "g") for end in interval)
        return f"[{low}, {high}]"


class NoSolution(ValueError):
    """A pose or a set of joints at which the mechanism cannot be assembled."""


@dataclass(frozen=True, slots=True, eq=False)
class KinematicSolution:
    """Joints or poses (N, k); rows at which the mechanism cannot be assembled hold NaN.

    Whoever has not looked at `found` takes the values by `values_or_raise`.
    """

    values: Array
    found: Mask
    """Rows that hold a solution, (N,)."""

    @classmethod
    def where(cls, found: Mask, values: Array) -> Self:
        """Values (N, k) of the rows that were found, NaN elsewhere."""
        values[~found] = np.nan
        return cls(values, found)

    def values_or_raise(self) -> Array:
        """Values of all rows; raises `NoSolution` naming the first row that has none."""
        if not np.all(self.found):
            row = int(np.argmin(self.found))
            raise NoSolution(f"no assembly for row {row} of {len(self.found)}")
        return self.values


@dataclass(frozen=True, slots=True)
class Limits:
    """Motion limits of a robot, and how near it may come to what it cannot do."""

    joint: Interval
    """Limits of every joint, rad or mm."""
    task: tuple[Interval | None, ...]
    """Limits of each task coordinate; None: the workspace alone limits it."""
    forearm_swing_rad: float
    singularity_margin: float = SINGULARITY_MARGIN
    elbow_margin: float = ELBOW_MARGIN

    def drawn_in(
        self, *, joint: float = 0.0, task: float = 0.0, swing_rad: float = 0.0
    ) -> "Limits":
        """Narrower limits, by so much at each end; negative amounts widen them."""
        low, high = self.joint
        return replace(
            self,
            joint=(low + joint, high - joint),
            task=tuple(each and (each[0] + task, each[1] - task) for each in self.task),
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


ArmWords: TypeAlias = tuple[str, str, str]
"""In words: where a joint moves its forearm's upper end, how swing is counted, that end's name."""


@dataclass(frozen=True, slots=True, eq=False)
class Feasibility:
    """Margins of poses, and what they violate. Rows out of reach hold NaN in every margin."""

    poses: Array
    """(N, t)"""
    joints: Array
    """(N, n)"""
    swing_rad: Array
    """Angle of each forearm out of its arm's plane, or away from its rail, (N, n)."""
    singular_value: Array
    """Smallest of the closures' Jacobian, as `SINGULARITY_MARGIN` has it, (N,)."""
    elbow: Array
    """Share of a forearm along which its joint moves it, of the least arm, (N,)."""
    violations: NDArray[np.uint8]
    """`Violation` flags, (N,); zero when the pose can be taken."""
    limits: Limits
    joint_axes: tuple[Axis, ...]
    task_axes: tuple[Axis, ...]
    words: ArmWords

    @property
    def feasible(self) -> Mask:
        """Poses that can be taken, (N,)."""
        return np.asarray(self.violations == Violation.NONE)

    def describe(self, row: int, limits: Limits | None = None) -> list[str]:
        """Violations of one pose in words, each with its value and limit.

        `limits` are those to be named, if others were tested with.
        """
        limits = limits or self.limits
        violated = Violation(int(self.violations[row]))
        if Violation.OUT_OF_REACH in violated:
            return [f"out of reach: a forearm cannot span from {self.words[0]} to the plate"]
        found = [
            f"joint {place} at {axis.text(value, '.3f')} outside {axis.span(limits.joint)}"
            for place, (axis, value) in enumerate(
                zip(self.joint_axes, self.joints[row], strict=True)
            )
            if outside(value, limits.joint)
        ]
        if Violation.TASK_LIMIT in violated:
            found += self._beyond_task_limits(row, limits)
        found += [
            f"forearm {place} swings {np.degrees(swing):.2f}° {self.words[1]}, limit "
            f"{np.degrees(limits.forearm_swing_rad):g}°"
            for place, swing in enumerate(self.swing_rad[row])
            if abs(swing) > limits.forearm_swing_rad
        ]
        if Violation.ABOVE_ELBOWS in violated:
            found.append(f"another assembly: the platform would be above its {self.words[2]}s")
        if Violation.SINGULAR in violated:
            found.append(
                f"too near a singularity: margin {self.singular_value[row]:.3f} "
                f"(limit {limits.singularity_margin:g}), "
                f"{self.words[2]} {self.elbow[row]:.3f} (limit {limits.elbow_margin:g})"
            )
        return found

    def _beyond_task_limits(self, row: int, limits: Limits) -> list[str]:
        columns = zip(self.task_axes, self.poses[row], limits.task, strict=True)
        return [
            f"{axis.name} {axis.text(value, '.3f')} outside {axis.span(interval)}"
            for axis, value, interval in columns
            if interval is not None and outside(value, interval)
        ]


@dataclass(frozen=True, slots=True, eq=False)
class Kinematics:
    """Kinematic model of one robot: a mechanism with its parameter vector."""

    mechanism: "ClosedChain"
    p: Array
    """(P,), or the geometry alone, (G,); mm and rad."""

    @classmethod
    def of(cls, mechanism: "ClosedChain", values: Mapping[str, float]) -> Self:
        """Model from values by name in mm and deg; raises `KeyError` when one is missing.

        Ripples come as often as the values say; where they don't, as the mechanism's.
        """
        own = Parameters.of(mechanism.parameters, values)
        return cls(mechanism.with_ripples(own.rate) if own.rate else mechanism, own.vector)

    @property
    def parameters(self) -> Parameters:
        """Parameters by name in mm and deg."""
        return Parameters.of_vector(self.mechanism.parameters, self.p, self.mechanism.rate)

    @property
    def controlled(self) -> "Kinematics":
        """Model of the point that the controller's poses are of, wherever the reflector is."""
        return replace(self, mechanism=self.mechanism.seen_from(None))

    def inverse(self, poses: ArrayLike, approach: ArrayLike | None = None) -> KinematicSolution:
        """Encoder readings (N, n) of poses (N, t) that the joints reach by `approach` (N, n)."""
        return self.mechanism.inverse(self.p, self._poses(poses), self._approach(approach))

    def assembles(self, poses: Array) -> Mask:
        """Whether poses (N, t) have joints, and these lead back to an assembly there, (N,)."""
        joints = self.inverse(poses)
        found = joints.found.copy()
        found[found] = self.forward(joints.values[found], poses[found]).found
        return found

    def forward(
        self, joints: ArrayLike, near: ArrayLike | None = None, approach: ArrayLike | None = None
    ) -> KinematicSolution:
        """Poses (N, t) of encoder readings (N, n), from poses `near` them where there are such.

        `approach` (N, n): the sign of each joint's last motion, 0 where it is not known.
        """
        starts = None if near is None else self._poses(near)
        return self.mechanism.forward(
            self.p, self._joints(joints), starts, self._approach(approach)
        )

    def jacobian(
        self, joints: ArrayLike, poses: ArrayLike, approach: ArrayLike | None = None
    ) -> Array:
        """d(pose)/dp (N, t, P) at fixed joints; raises `LinAlgError` at a singular pose."""
        at, ways = (self._joints(joints), self._poses(poses)), self._approach(approach)
        return self.mechanism.jacobian(self.p, *at, ways)

    def joint_jacobian(
        self, joints: ArrayLike, poses: ArrayLike, approach: ArrayLike | None = None
    ) -> Array:
        """d(pose)/d(encoder readings) (N, t, n); raises `LinAlgError` at a singular pose."""
        by_offsets = self.jacobian(joints, poses, approach)[:, :, self.mechanism.parameters.offsets]
        slopes = self.mechanism.joint_slopes(self.p, self._joints(joints))
        return np.asarray(by_offsets * slopes[:, None])

    def feasibility(self, limits: Limits, poses: ArrayLike) -> Feasibility:
        """Margins of poses (N, t), and each violation."""
        return self.mechanism.feasibility(self.p, limits, self._poses(poses))

    def _poses(self, poses: ArrayLike) -> Array:
        return batch(poses, [axis.name for axis in self.mechanism.task], "poses")

    def _joints(self, joints: ArrayLike) -> Array:
        return batch(joints, [axis.name for axis in self.mechanism.joints], "joints")

    def _approach(self, approach: ArrayLike | None) -> Array | None:
        names = [axis.name for axis in self.mechanism.joints]
        return None if approach is None else batch(approach, names, "approach")

    def comparable(self, joints: Array) -> Array:
        """Joints (…, n) in units that compare with a radian of a crank."""
        return np.asarray(joints / np.array([axis.scale for axis in self.mechanism.joints]))


def outside(values: Array, interval: Interval) -> Mask:
    """Values that leave an interval; NaN does not."""
    return np.asarray((values < interval[0]) | (values > interval[1]))
