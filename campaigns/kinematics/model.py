"""Kinematic model of one robot: a mechanism with its parameters, checked at the door.

Joints (N, n) and poses (N, t) are batches, a row each, one column an axis, in rad and mm.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from campaigns.arrays import Array, Mask, batch
from campaigns.kinematics.feasibility import Feasibility, Limits, feasibility
from campaigns.kinematics.mechanism import Mechanism
from campaigns.kinematics.parameters import Parameters, stated_rates


class NoSolution(ValueError):
    """Pose or set of joints at which the mechanism cannot be assembled."""


@dataclass(frozen=True, slots=True, eq=False)
class KinematicSolution:
    """Joints or poses of a batch, and the rows at which the mechanism can be assembled."""

    values: Array
    """Joints or poses, (N, k); NaN in rows without a solution."""
    is_solved: Mask
    """Rows that hold a solution, (N,)."""

    @classmethod
    def where(cls, is_solved: Mask, values: Array) -> Self:
        """Take the values (N, k) of the solved rows, NaN elsewhere."""
        values[~is_solved] = np.nan
        return cls(values, is_solved)

    def values_or_raise(self) -> Array:
        """Return the values of all rows; raise `NoSolution` with the first row without a value."""
        if not np.all(self.is_solved):
            row = int(np.argmin(self.is_solved))
            raise NoSolution(f"no assembly for row {row} of {len(self.is_solved)}")
        return self.values


@dataclass(frozen=True, slots=True, eq=False)
class Kinematics:
    """Kinematic model of one robot: `forward`, `inverse` and their derivatives, for many rows.

    `robot.kinematics` is that of a robot file. Joints (N, n) and poses (N, t) have a row each, in
    rad and mm; a single row may be given alone.

    Attributes:
        mechanism: The mechanism, with `joints`, `task` and the table of `parameters`.
        p: Parameters in the order of that table, mm, rad and ratios.

    Example:
        >>> model = find_robot("delta").kinematics
        >>> joints = model.inverse([[0.0, 0.0, -700.0]]).values_or_raise()
        >>> model.forward(joints).values_or_raise()[0, 2].round(6)
        -700.0
    """

    mechanism: Mechanism
    p: Array
    """Parameters (P,), or the geometry alone, (G,); mm, rad and ratios."""

    @classmethod
    def of(cls, mechanism: Mechanism, values: Mapping[str, float]) -> Self:
        """Make a model from values by name in mm and deg; raise `KeyError` for a missing value."""
        rates = stated_rates(mechanism.parameters, values, mechanism.rates)
        parameters = Parameters.of(mechanism.parameters, values)
        return cls(mechanism.with_ripples(rates), parameters.vector)

    @property
    def parameters(self) -> Parameters:
        """Parameters by name in mm and deg."""
        return Parameters.of_vector(self.mechanism.parameters, self.p, self.mechanism.rates)

    @property
    def whole_p(self) -> Array:
        """Copy of all parameters, (P,): 0 where `p` holds the geometry alone."""
        return self.mechanism.parameters.whole(self.p)

    @property
    def controlled(self) -> "Kinematics":
        """Model of the point that the controller's poses are of, wherever the reflector is."""
        return replace(self, mechanism=self.mechanism.seen_from(None))

    def inverse(self, poses: ArrayLike, approach: ArrayLike | None = None) -> KinematicSolution:
        """Return the encoder readings (N, n) of poses (N, t).

        `approach` (N, n) holds the sign of each joint's last motion, 0 if unknown.
        """
        joints, is_solved = self.mechanism.inverse(
            self.p, self._poses(poses), self._signs(approach)
        )
        return KinematicSolution(joints, is_solved)

    def forward(
        self, joints: ArrayLike, near: ArrayLike | None = None, approach: ArrayLike | None = None
    ) -> KinematicSolution:
        """Return the poses (N, t) of encoder readings (N, n), near given poses if there are any.

        `approach` (N, n) holds the sign of each joint's last motion, 0 if unknown.
        """
        start = None if near is None else self._poses(near)
        signs = self._signs(approach)
        assembly = self.mechanism.assemble(self.p, self._joints(joints), start, signs)
        return KinematicSolution(assembly.poses, assembly.is_solved)

    def select_reachable(self, poses: Array) -> tuple[Array, Array]:
        """Return the poses (M, t) among (N, t) that the robot can take, after their joints (M, n).

        A pose counts if it has joints, and if these joints assemble again.
        """
        joints = self.inverse(poses)
        is_solved = joints.is_solved.copy()
        is_solved[is_solved] = self.forward(joints.values[is_solved], poses[is_solved]).is_solved
        return joints.values[is_solved], poses[is_solved]

    def jacobian(
        self, joints: ArrayLike, poses: ArrayLike, approach: ArrayLike | None = None
    ) -> Array:
        """Return d(pose)/dp (N, t, P) at fixed joints; raise `LinAlgError` at a singular pose."""
        signs = self._signs(approach)
        return self.mechanism.jacobian(self.p, self._joints(joints), self._poses(poses), signs)

    def points(self, poses: Array) -> Array:
        """Return the places (N, 3) of the measured point in the base frame, at poses (N, t)."""
        return self.mechanism.points(poses)

    def point_jacobian(
        self, joints: ArrayLike, poses: Array, approach: ArrayLike | None = None
    ) -> Array:
        """Return d(measured point)/dp (N, 3, P) at fixed joints, of poses (N, t) there."""
        return self.mechanism.point_rows(poses, self.jacobian(joints, poses, approach))

    # A joint's offset δ adds to its true angle: dX/dq = dX/dδ · (d true/dq). The second factor
    # differs from 1 by the slope of the transmission's errors alone.
    def joint_jacobian(
        self, joints: ArrayLike, poses: ArrayLike, approach: ArrayLike | None = None
    ) -> Array:
        """Return d(pose)/d(encoder readings) (N, t, n); raise `LinAlgError` at a singular pose."""
        columns = self.mechanism.parameters.columns
        by_offsets = self.jacobian(joints, poses, approach)[..., columns["joint_offset"]]
        slopes = self.mechanism.joint_slopes(self.p, self._joints(joints))
        return np.asarray(by_offsets * slopes[:, None])

    def feasibility(self, limits: Limits, poses: ArrayLike) -> Feasibility:
        """Return the margins of poses (N, t), and each violation."""
        return feasibility(self.mechanism, self.p, limits, self._poses(poses))

    def comparable(self, joints: Array) -> Array:
        """Return joints (…, n) in units that compare with a radian of a crank."""
        return np.asarray(joints / self.mechanism.joint_scales)

    def _poses(self, poses: ArrayLike) -> Array:
        return batch(poses, [axis.name for axis in self.mechanism.task], "poses")

    def _joints(self, joints: ArrayLike) -> Array:
        return batch(joints, [axis.name for axis in self.mechanism.joints], "joints")

    def _signs(self, approach: ArrayLike | None) -> Array | None:
        names = [axis.name for axis in self.mechanism.joints]
        return None if approach is None else batch(approach, names, "approach")
