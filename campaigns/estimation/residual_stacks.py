"""Residuals of many campaigns with the same joints, in stacks: those of `residuals.py`, row by row.

Of level plates and perfect transmissions. Arrays lie by campaign and component, (C, 3, N): long
rows are what the processor is fast at.
"""

from collections.abc import Sequence

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.estimation.point_sets import TINY_MM
from campaigns.estimation.residuals import CLOSE_ENOUGH_MM, FRAME_COLUMNS
from campaigns.estimation.rigid_transforms import Transform, small_rotation
from campaigns.mechanisms.closed_chain import ClosedChain
from campaigns.mechanisms.configuration import Configuration


class RobotStack:
    """Robots of parameters (C, P), of which some are free, at joints (N, n).

    `near` are poses (C, t, N) near theirs.
    """

    def __init__(
        self,
        mechanism: ClosedChain,
        p: Array,
        free: Index,
        joints: Array,
        near: Array,
        converged_mm: float = CLOSE_ENOUGH_MM,
    ) -> None:
        self._mechanism, self._p, self._free, self._joints = mechanism, p, free, joints
        self._converged_mm = converged_mm
        self.poses, (count, tasks, shots) = near.copy(), near.shape
        """Those last asked for, (C, t, N)."""
        self._about = self.start
        self._by_x = np.zeros((count, tasks, shots, len(free)))
        self.by_joints = np.zeros((count, 3, shots, joints.shape[1]))
        """∂point/∂joints where Jacobians were last asked for, (C, 3, N, n)."""
        self._last: tuple[Index, Configuration] | None = None

    @property
    def start(self) -> Array:
        """Free parameters of the robots as they were given, (C, F)."""
        return self._p[:, self._free]

    def positions_mm(self, x: Array, rows: Index) -> tuple[Array, Mask]:
        """Positions (R, 3, N) of these robots with parameters (R, F); which have all of them."""
        tasks, shots = self.poses.shape[1:]
        further = (x - self._about[rows])[:, :, None]
        expected = self._by_x[rows].reshape(len(rows), -1, x.shape[1]) @ further
        near = self.poses[rows] + expected.reshape(len(rows), tasks, shots)
        configuration = self._configuration(x, rows)
        start = near.swapaxes(1, 2).reshape(-1, tasks)
        solution = configuration.assemble(start, self._converged_mm)
        poses = solution.values.reshape(len(rows), shots, tasks).swapaxes(1, 2)
        self.poses[rows], self._about[rows], self._last = poses, x, (rows, configuration)
        found = solution.found.reshape(len(rows), -1).all(axis=1)
        return poses[:, :3], np.asarray(found)

    def jacobian(self, x: Array, rows: Index) -> tuple[Array, Array]:
        """Positions (R, 3, N) where they were last asked for, and derivatives, (R, 3, N, F)."""
        poses, here, last, p = self.poses[rows], rows, self._last, self._p[rows]
        if all((each == each[0]).all() for each in (x, poses, p)):  # as where all begin
            here, x = rows[:1], x[:1]
        is_last = last is not None and np.array_equal(last[0], here)
        configuration = last[1] if last and is_last else self._configuration(x, here)
        flat = self.poses[here].swapaxes(1, 2).reshape(-1, poses.shape[1])
        by_all = configuration.jacobian(flat, extended=False).transpose(1, 2, 0)
        self._by_x[rows] = self._by_robot(by_all[:, self._free], len(x))
        by_joints = by_all[:3, self._mechanism.parameters.offsets]
        self.by_joints[rows] = self._by_robot(by_joints, len(x))
        return poses[:, :3], self._by_x[rows][:, :3]

    def _configuration(self, x: Array, rows: Index) -> Configuration:
        p = self._p[rows].T
        p[self._free] = x.T
        return self._mechanism.configuration(p, np.tile(self._joints, (len(x), 1)))

    @staticmethod
    def _by_robot(columns: Array, robots: int) -> Array:
        """Columns (t, F, R N) as (R, t, N, F)."""
        return columns.reshape(*columns.shape[:2], robots, -1).transpose(2, 0, 3, 1)


def with_frames(parameters: Array) -> Array:
    """Unknowns (C, F + 6) of parameters (C, F), frames as they are guessed."""
    return np.pad(parameters, ((0, 0), (0, FRAME_COLUMNS)))


class PointStack:
    """Whitened coordinates (C, 3, N) of shots, behind the parameters frames that correct guesses.

    `whitening` is lower triangular, (C, 3, 3, N).
    """

    def __init__(
        self, robots: RobotStack, points_mm: Array, whitening: Array, guesses: Sequence[Transform]
    ) -> None:
        self.robots = robots
        self._points_mm, self._whitening = points_mm, whitening
        self._rotation = np.array([guess.rotation for guess in guesses])
        self._translation_mm = np.array([guess.translation_mm for guess in guesses])

    def start(self) -> Array:
        """Nominal parameters and guessed frames, (C, F + 6)."""
        return with_frames(self.robots.start)

    def rotations(self, x: Array, rows: Index) -> Array:
        """From base to tracker, (R, 3, 3)."""
        return np.asarray(self._rotation[rows] @ small_rotation(x[:, -6:-3])[0])

    def residual(self, x: Array, rows: Index) -> tuple[Array, Mask]:
        """Component by component, (R, 3 N); which have an answer."""
        positions, found = self.robots.positions_mm(x[:, :-FRAME_COLUMNS], rows)
        translation = self._translation_mm[rows] + x[:, -3:]
        modelled = self.rotations(x, rows) @ positions + translation[:, :, None]
        return self._whitened(modelled - self._points_mm[rows], rows), found

    def jacobian(self, x: Array, rows: Index) -> Array:
        """Derivatives by parameters and frame, (R, 3 N, F + 6)."""
        positions, by_robot = self.robots.jacobian(x[:, :-FRAME_COLUMNS], rows)
        count, _, shots, free = by_robot.shape
        turn, by_angle = small_rotation(x[:, -6:-3])
        jacobian = np.zeros((count, 3, shots, x.shape[1]))
        turned = (self._rotation[rows] @ turn) @ by_robot.reshape(count, 3, -1)
        jacobian[..., :free] = turned.reshape(by_robot.shape)
        by_angles = (self._rotation[rows][:, None] @ by_angle) @ positions[:, None]
        jacobian[..., free : free + 3] = by_angles.transpose(0, 2, 3, 1)
        for axis in range(3):
            jacobian[:, axis, :, free + 3 + axis] = 1.0
        return self._whitened(jacobian, rows).reshape(count, -1, x.shape[1])

    def whitened_by_joints(self, x: Array, rows: Index) -> Array:
        """∂point/∂joints where Jacobians were last asked for, (R, 3, N, n)."""
        by_joints = self.robots.by_joints[rows]
        turned = self.rotations(x, rows) @ by_joints.reshape(len(rows), 3, -1)
        return self._whitened(turned.reshape(by_joints.shape), rows)

    def _whitened(self, each: Array, rows: Index) -> Array:
        """Rows (R, 3, N, …) in units of their σ, in place; a vector's as (R, 3 N)."""
        w = self._whitening[rows].reshape(len(rows), 3, 3, -1, *(1,) * (each.ndim - 3))
        each[:, 2] *= w[:, 2, 2]
        each[:, 2] += w[:, 2, 0] * each[:, 0] + w[:, 2, 1] * each[:, 1]
        each[:, 1] *= w[:, 1, 1]
        each[:, 1] += w[:, 1, 0] * each[:, 0]
        each[:, 0] *= w[:, 0, 0]
        return each.reshape(len(rows), -1) if each.ndim == 3 else each


class DistanceStack:
    """Whitened distances (C, M) between shots `first` and `second` of robots, (M,) each."""

    def __init__(
        self, robots: RobotStack, first: Index, second: Index, measured_mm: Array, whitening: Array
    ) -> None:
        self.robots = robots
        self._first, self._second = first, second
        self._measured_mm, self._whitening = measured_mm, whitening

    def residual(self, x: Array, rows: Index) -> tuple[Array, Mask]:
        """(R, M); which have an answer."""
        positions, found = self.robots.positions_mm(x, rows)
        lengths = np.linalg.norm(self._between(positions), axis=1)
        return self._whitening[rows] * (lengths - self._measured_mm[rows]), found

    def jacobian(self, x: Array, rows: Index) -> Array:
        """Derivatives by parameters, (R, M, F)."""
        positions, by_x = self.robots.jacobian(x, rows)
        between = self._between(positions)
        lengths = np.maximum(np.linalg.norm(between, axis=1), TINY_MM)
        along = between * (self._whitening[rows] / lengths)[:, None]
        return np.asarray(np.sum(along[..., None] * self._between(by_x), axis=1))

    def _between(self, each: Array) -> Array:
        """From first to second shots, (R, 3, M, …) of (R, 3, N, …)."""
        return np.asarray(each[:, :, self._second] - each[:, :, self._first])
