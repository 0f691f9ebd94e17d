"""Residuals of many campaigns with the same joints, in stacks: those of `residuals.py`, row by row.

Of perfect transmissions; plates may tilt. Arrays lie by campaign and component, (C, 3, N): long
rows are what the processor is fast at.
"""

from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.estimation.gauss_newton import normal_step, product, rows_of, with_rows
from campaigns.estimation.point_sets import TINY_MM
from campaigns.estimation.residuals import CLOSE_ENOUGH_MM, FRAME_COLUMNS
from campaigns.estimation.rigid_transforms import small_rotation
from campaigns.mechanisms.closed_chain import ClosedChain
from campaigns.mechanisms.closure_coefficients import (
    Closures,
    are_combinations,
    closures,
    ends_by_platform,
    joint_functions,
    joint_slopes,
    owners,
)
from campaigns.mechanisms.configuration import CONVERGED_MM, Configuration, TiltElimination
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.parameters import ParameterSpace

WITH_TURN = 4
"""Task coordinates of any mechanism, whether its platform turns or not."""
KEPT_BYTES = 31 * 2**20
"""The most, but for 1 MB, that glibc takes as a sign of how much to keep."""

# freed at once: glibc then keeps what stacks free, up to twice as much, for the next ones; to give
# pages back and have them cleared again took an eighth of a campaign's time
np.empty(KEPT_BYTES, dtype=np.uint8)


def closure_kernel(robot: Kinematics) -> ModuleType | None:
    """Compiled loops, where numba is installed and they can express the robot's closures."""
    if find_spec("numba") is None or not are_combinations(robot):
        return None
    try:
        return import_module("campaigns.estimation.compiled")
    except (ImportError, RuntimeError):  # numba of another NumPy; nowhere to keep what it compiles
        return None


class RobotStack:
    """Robots of parameters (C, P), of which some are free, at joints (N, n).

    `near` are poses (C, t, N) near theirs. `kernel`: `compiled.py`, where it can be used. What is
    known of closures of the same robots `about` joints of their own is not read off again.
    """

    def __init__(
        self,
        mechanism: ClosedChain,
        p: Array,
        free: Index,
        joints: Array,
        near: Array,
        converged_mm: float = CLOSE_ENOUGH_MM,
        kernel: ModuleType | None = None,
        about: "RobotStack | None" = None,
    ) -> None:
        self._mechanism, self._p, self._free, self._joints = mechanism, p, free, joints
        named = len(mechanism.parameters.names)
        are_level = not p[:, named:].any()
        self.fine_parameters: Mask = (free >= named) & are_level
        """Free parameters that tilt a level plate, (F,)."""
        self._tilts = not are_level or bool(self.fine_parameters.any())
        self._converged_mm, self.kernel = converged_mm, None if self._tilts else kernel
        count, tasks, shots = near.shape
        self._padded = np.zeros((count, WITH_TURN, shots))
        self.poses = self._padded[:, :tasks]
        """Those last asked for, (C, t, N)."""
        self.poses[:] = near
        self._about = self.start
        self._last: tuple[Index, Configuration] | None = None
        self._tilting: tuple[Array, ...] = ()
        """Tilts and their elimination where Jacobians were last asked for, (…, C, N)."""
        offsets = mechanism.parameters.offsets
        self._columns = np.append(free, np.setdiff1d(offsets, free))
        self._has_azimuths = bool(np.isin(free, mechanism.azimuths).any())
        self._of_offsets = np.argmax(self._columns == offsets[:, None], axis=1)
        if self.kernel is None:
            self._by_p = np.zeros((tasks, len(self._columns), count, shots))
            self._gibbs = np.zeros((3, count, shots))
        else:
            self._functions = joint_functions(mechanism, joints)
            self._by_platform = ends_by_platform(mechanism, p[0])
            self._owners = owners(mechanism, self._columns)[0]
            self.closed: tuple[Array, Closures] = np.full_like(self.start, np.nan), ()
            """Closures known, with derivatives by `_columns`, and of which parameters (C, F)."""
            if about is not None:
                of, known = about.closed
                self.closed = of.copy(), tuple(each.copy() for each in known)

    @property
    def start(self) -> Array:
        """Free parameters of the robots as they were given, (C, F)."""
        return self._p[:, self._free]

    def first_jacobian(self) -> tuple[Array, Array]:
        """Positions (3, N) and derivatives (3, N, F) of robots that are still one, at its poses."""
        configuration = self._configuration(self.start[:1], np.zeros(1, dtype=np.intp))
        by_p = self._differentiated(configuration, self.poses[0].T, np.arange(len(self.poses)))
        if self.kernel is None:
            self._by_p[:] = by_p[:, :, None]
        return self.poses[0, :3], by_p[:3, : len(self._free)].swapaxes(1, 2)

    def positions_mm(self, x: Array, rows: Index) -> tuple[Array, Mask]:
        """Positions (R, 3, N) of these robots with parameters (R, F); which have all of them."""
        if self.kernel is not None:
            return self._assembled(self.kernel, x, rows)
        tasks, shots = self.poses.shape[1:]
        further = (x - self._about[rows])[:, None, None]
        moved = further @ self._by_x(rows).transpose(2, 0, 1, 3)
        near = self.poses[rows] + moved[:, :, 0]
        configuration, about = self._configuration(x, rows), self._tilting_of(rows)
        start = near.swapaxes(1, 2).reshape(-1, tasks)
        solution, gibbs = configuration.follow(start, self._converged_mm, about)
        poses = solution.values.reshape(len(rows), shots, tasks).swapaxes(1, 2)
        self.poses[rows], self._about[rows], self._last = poses, x, (rows, configuration)
        self._gibbs[:, rows] = gibbs.reshape(3, len(rows), shots)
        found = solution.found.reshape(len(rows), -1).all(axis=1)
        return poses[:, :3], np.asarray(found)

    def jacobian(self, x: Array, rows: Index) -> tuple[Array, Array]:
        """Positions (R, 3, N) where they were last asked for, and derivatives, (3, F, R, N)."""
        poses, last = self.poses[rows], self._last
        is_last = last is not None and np.array_equal(last[0], rows)
        configuration = last[1] if last and is_last else self._configuration(x, rows)
        flat = poses.swapaxes(1, 2).reshape(-1, poses.shape[1])
        gibbs = _of(self._gibbs, rows).reshape(3, -1)
        by_p = self._differentiated(configuration, flat, rows, gibbs)
        by_p = by_p.reshape(*by_p.shape[:2], len(x), -1)
        if len(rows) == len(self.poses):
            self._by_p = by_p
        else:
            self._by_p[:, :, rows] = by_p
        return poses[:, :3], by_p[:3, : len(self._free)]

    def _differentiated(
        self, configuration: Configuration, poses: Array, rows: Index, gibbs: Array | None = None
    ) -> Array:
        """d(pose)/d(what columns are kept of) (t, K, …) of these robots, or of one that all are.

        Of poses (…, t) and tilts (3, …), if they are known.
        """
        if not self._tilts:
            return configuration.level_columns(poses, self._columns)
        by_all = configuration.jacobian(poses, azimuths=self._has_azimuths, gibbs=gibbs)
        count, shots = self._gibbs.shape[1:]
        assert configuration.tilt_elimination is not None, "left behind by a Jacobian of all"
        about, elimination = configuration.tilt_elimination
        anew = [each.reshape(*each.shape[:-1], -1, shots) for each in (about, *elimination)]
        if not self._tilting:
            self._tilting = tuple(np.empty((*each.shape[:-2], count, shots)) for each in anew)
        for kept, each in zip(self._tilting, anew, strict=True):
            kept[..., rows, :] = each
        return by_all.transpose(1, 2, 0)[:, self._columns]

    def _tilting_of(self, rows: Index) -> TiltElimination | None:
        """Tilts and elimination about which derivatives of these robots are known."""
        if not self._tilting:
            return None
        gibbs, *elimination = (
            _of(each, rows).reshape(*each.shape[:-2], -1) for each in self._tilting
        )
        by_closure, eliminated, by_turn, by_pose = elimination
        return gibbs, (by_closure, eliminated, by_turn, by_pose)

    def by_joints(self, rows: Index) -> Array:
        """∂point/∂joints (3, n, R, N) where Jacobians were last asked for."""
        return self._by_p[:3, self._of_offsets][:, :, rows]

    def _by_x(self, rows: Index) -> Array:
        """d(pose)/dx (t, F, R, N) of these robots where it was last asked for."""
        return _of(self._by_p[:, : len(self._free)], rows)

    def joint_slopes(self) -> Array:
        """Derivatives by the joints of the functions that closures are made of, (2, n, N)."""
        return joint_slopes(self._mechanism, self._joints)

    def closed_at(
        self, x: Array, rows: Index, *, by_offsets: bool = False
    ) -> tuple[Array | Index, ...]:
        """Closures where positions were last asked for, and derivatives as the kernel takes them.

        By the free parameters, or by those of the joints' offsets.
        """
        upper, _, lower, *_, by_upper, own_mm = self._closures(x, rows)
        owner, wanted = self._owners, self._of_offsets if by_offsets else slice(len(self._free))
        if by_offsets or len(owner) > len(self._free):
            some = (np.ascontiguousarray(each[:, wanted]) for each in (by_upper, own_mm))
            owner, (by_upper, own_mm) = owner[wanted], some
        poses = rows_of(self._padded, rows)
        return self._functions, upper, lower, by_upper, owner, own_mm, self._by_platform, poses

    def _closures(self, x: Array, rows: Index) -> Closures:
        """Those of these robots with parameters (R, F), read off where they are not known."""
        of, known = self.closed
        stale = (of[rows] != x).any(axis=1)
        if (own := rows[stale]).size:
            p = self._p_of(x[stale], own)
            found = closures(self._mechanism, p, self._columns, self._by_platform)
            known = known or tuple(np.zeros((len(of), *each.shape[1:])) for each in found)
            known = tuple(with_rows(old, own, new) for old, new in zip(known, found, strict=True))
            of[own] = x[stale]
            self.closed = of, known
        return tuple(rows_of(each, rows) for each in known)

    def _assembled(self, kernel: ModuleType, x: Array, rows: Index) -> tuple[Array, Mask]:
        found, poses = self._closures(x, rows), rows_of(self._padded, rows)
        is_found = kernel.assemble(self._functions, *found[:6], CONVERGED_MM, poses)
        if poses is not self._padded:
            self._padded[rows] = poses
        return poses[:, :3], np.asarray(is_found)

    def _p_of(self, x: Array, rows: Index) -> Array:
        """Parameters (P, R) of these robots with free ones (R, F)."""
        p = self._p[rows].T
        p[self._free] = x.T
        return p

    def _configuration(self, x: Array, rows: Index) -> Configuration:
        joints = np.tile(self._joints, (len(x), 1))
        return self._mechanism.configuration(self._p_of(x, rows), joints)


def can_be_stacked(space: ParameterSpace, p: Array, free: Index) -> bool:
    """Whether stacks can hold robots (C, P) of which these parameters are free.

    Of imperfect transmissions and warmth each shot has its own, which only `PositionModel` knows.
    """
    geometry = len(space.geometry)
    return bool((free < geometry).all() and not p[:, geometry:].any())


def _of(stack: Array, rows: Index) -> Array:
    """Rows (…, R, N) of a stack (…, C, N), without a copy where these are all."""
    return stack if len(rows) == stack.shape[-2] else stack[..., rows, :]


def with_frames(parameters: Array) -> Array:
    """Unknowns (C, F + 6) of parameters (C, F), frames as they are guessed."""
    return np.pad(parameters, ((0, 0), (0, FRAME_COLUMNS)))


def _columns(count: int, measured: int, unknowns: int) -> Array:
    """Jacobians (C, M, P) of zeros that lie in memory as new ones do, column by column.

    Sums are added up as numbers lie: laid out otherwise they would differ by rounding.
    """
    return np.zeros((count, unknowns, measured)).swapaxes(1, 2)


class PointStack:
    """Whitened coordinates (C, 3, N) of shots, behind the parameters frames that correct guesses.

    `whitening` is lower triangular, (C, 3, 3, N); guesses are rotations (C, 3, 3) and translations.
    """

    def __init__(
        self, robots: RobotStack, points_mm: Array, whitening: Array, guesses: tuple[Array, Array]
    ) -> None:
        self.robots = robots
        self._points_mm, self.whitening = points_mm, whitening
        self._rotation, self._translation_mm = guesses
        none = np.empty((0, 3, 3))
        self._last: tuple[Index, Array, tuple[Array, Array]] = np.empty(0, int), none, (none, none)
        """Rows and angles (R, 3) that were last turned by, and what `_turned` gave."""
        count, free = robots.start.shape
        if robots.kernel is None:
            self._jacobians = _columns(count, 3 * points_mm.shape[2], free + FRAME_COLUMNS)
        else:
            unknowns = free + FRAME_COLUMNS
            shapes = (3 * points_mm.shape[2],), (unknowns,), (unknowns, unknowns)
            self._of_steps = tuple(np.zeros((count, *shape)) for shape in shapes)
            """Changes by last steps, norms of derivatives, and roots of their products."""

    def start(self) -> Array:
        """Unknowns (C, F + 6) where a step leads from one robot and guessed frames.

        With every point counting alike, as all rows have then the same derivatives. What tilts a
        level plate waits: it would take up what is bent of the others.
        """
        positions, by_robot = self.robots.first_jacobian()
        by_angle = (small_rotation(np.zeros(3))[1] @ positions).transpose(1, 2, 0)
        by_shift = np.broadcast_to(np.eye(3)[:, None], by_angle.shape)
        columns = np.concatenate([by_robot, by_angle, by_shift], axis=2)
        coarse = np.flatnonzero(
            np.append(~self.robots.fine_parameters, np.ones(FRAME_COLUMNS, dtype=bool))
        )
        basis, triangle = np.linalg.qr(columns.reshape(positions.size, -1)[:, coarse])
        back = self._rotation.swapaxes(1, 2)
        seen = back @ (self._points_mm - self._translation_mm[:, :, None])
        left = (seen - positions).reshape(len(seen), 1, -1)
        step = (left @ np.linalg.solve(triangle, basis.T).T)[:, 0]
        step[:, -3:] = (self._rotation @ step[:, -3:, None])[:, :, 0]
        start = with_frames(self.robots.start)
        start[:, coarse] += step
        return start

    def residual(self, x: Array, rows: Index) -> tuple[Array, Mask]:
        """Component by component, (R, 3 N); which have an answer."""
        positions, found = self.robots.positions_mm(x[:, :-FRAME_COLUMNS], rows)
        translation, (rotation, _) = self._translation_mm[rows] + x[:, -3:], self._turned(x, rows)
        points, whitening = rows_of(self._points_mm, rows), rows_of(self.whitening, rows)
        if self.robots.kernel is not None:
            modelled = positions, rotation, translation
            return self.robots.kernel.point_residuals(*modelled, points, whitening), found
        modelled_mm = rotation @ positions + translation[:, :, None]
        return self._whitened(modelled_mm - points, rows), found

    def step(self, x: Array, residual: Array, rows: Index) -> tuple[Array, Array, Mask]:
        """Step of Gauss-Newton from residuals (R, 3 N), as `normal_step`."""
        if self.robots.kernel is not None:
            step, length, regular, *anew = self.robots.kernel.point_steps(
                *self._closed_at(x, rows), residual
            )
            both = zip(self._of_steps, anew, strict=True)
            self._of_steps = tuple(with_rows(old, rows, new) for old, new in both)
            return step, length, regular
        jacobian = self.jacobian(x, rows)
        self._jacobians = with_rows(self._jacobians, rows, jacobian)
        return normal_step(jacobian, residual)

    def change(self, step: Array, rows: Index) -> Array:
        """Change (R, 3 N) of residuals by last steps (R, F + 6)."""
        if self.robots.kernel is not None:
            return rows_of(self._of_steps[0], rows)
        return product(rows_of(self._jacobians, rows), step)

    def last_jacobians(self, x: Array, rows: Index) -> Array:
        """Jacobians (R, 3 N, F + 6) where steps were last taken, or as near to there."""
        return (
            rows_of(self._jacobians, rows) if self.robots.kernel is None else self.jacobian(x, rows)
        )

    def scored(self, x: Array, residual: Array, rows: Index) -> tuple[Array, Mask, Array] | None:
        """Covariances (R, P, P) at residuals (R, 3 N), and whose rank is beyond doubt.

        And scores (2, R) of the robot's own scatter; behind a step. None without a kernel.
        """
        if (kernel := self.robots.kernel) is None:
            return None
        closed, slopes = self._closed_at(x, rows), self.robots.joint_slopes()
        roots = (rows_of(each, rows) for each in self._of_steps[1:])
        found = kernel.point_scores(*closed, slopes, residual, *roots)
        return found[0], found[1], found[2]

    def _closed_at(self, x: Array, rows: Index) -> tuple[object, ...]:
        """Closures and frames as the kernel takes them."""
        closed = self.robots.closed_at(x[:, :-FRAME_COLUMNS], rows)
        rotation, by_angle = self._turned(x, rows)
        return closed, rotation, by_angle, rows_of(self.whitening, rows)

    def _turned(self, x: Array, rows: Index) -> tuple[Array, Array]:
        """Rotations from base to tracker (R, 3, 3), and by their angles (R, 3, 3, 3)."""
        angles, guesses = x[:, -6:-3].copy(), self._rotation[rows]
        last_rows, last_angles, turned = self._last
        if np.array_equal(last_rows, rows) and np.array_equal(last_angles, angles):
            return turned
        if self.robots.kernel is not None:
            turned = self.robots.kernel.turned(guesses, angles)
        else:
            turn, by_angle = small_rotation(angles)
            turned = guesses @ turn, guesses[:, None] @ by_angle
        self._last = rows, angles, turned
        return turned

    def jacobian(self, x: Array, rows: Index) -> Array:
        """Derivatives by parameters and frame, (R, 3 N, F + 6)."""
        if self.robots.kernel is not None:
            found = self.robots.kernel.point_jacobians(*self._closed_at(x, rows))
            return np.asarray(found.reshape(*found.shape[:2], -1).swapaxes(1, 2))
        rotation, by_angle = self._turned(x, rows)
        positions, by_robot = self.robots.jacobian(x[:, :-FRAME_COLUMNS], rows)
        count, _, shots = positions.shape
        turned = np.zeros((count, 3, x.shape[1], shots))
        turned[:, :, :-6] = self._turned_columns(rotation, by_robot)
        turned[:, :, -6:-3] = (by_angle @ positions[:, None]).swapaxes(1, 2)
        for axis in range(3):
            turned[:, axis, axis - 3] = 1.0
        return self._whitened_columns(turned, rows).reshape(count, x.shape[1], -1).swapaxes(1, 2)

    def whitened_by_joints(self, x: Array, rows: Index) -> Array:
        """∂point/∂joints where Jacobians were last asked for, (R, n, 3, N)."""
        rotation, _ = self._turned(x, rows)
        if self.robots.kernel is not None:
            closed = self.robots.closed_at(x[:, :-FRAME_COLUMNS], rows, by_offsets=True)
            frames = (rotation, np.empty((len(rows), 0, 3, 3)), rows_of(self.whitening, rows))
            return np.asarray(self.robots.kernel.point_jacobians(closed, *frames))
        turned = self._turned_columns(rotation, self.robots.by_joints(rows))
        return self._whitened_columns(turned, rows)

    @staticmethod
    def _turned_columns(rotation: Array, columns: Array) -> Array:
        """Columns (3, k, R, N) turned by rotations (R, 3, 3), as (R, 3, k, N)."""
        by_robot = columns.transpose(2, 0, 1, 3)
        return (rotation @ by_robot.reshape(len(rotation), 3, -1)).reshape(by_robot.shape)

    def _whitened_columns(self, columns: Array, rows: Index) -> Array:
        """Columns (R, 3, k, N) in units of their σ, as (R, k, 3, N)."""
        w = rows_of(self.whitening, rows)[:, :, :, None]
        found = np.empty(columns.swapaxes(1, 2).shape)
        for row in range(3):
            np.multiply(w[:, row, row], columns[:, row], out=found[:, :, row])
            for before in range(row):
                found[:, :, row] += w[:, row, before] * columns[:, before]
        return found

    def _whitened(self, each: Array, rows: Index) -> Array:
        """Vectors (R, 3, N) in units of their σ, (R, 3 N)."""
        return self._whitened_columns(each[:, :, None], rows).reshape(len(rows), -1)


class DistanceStack:
    """Whitened distances (C, M) between shots `first` and `second` of robots, (M,) each."""

    def __init__(
        self, robots: RobotStack, first: Index, second: Index, measured_mm: Array, whitening: Array
    ) -> None:
        self.robots = robots
        self._first, self._second = first, second
        self._measured_mm, self._whitening = measured_mm, whitening
        count, free = robots.start.shape
        self._jacobians = _columns(count, len(first), free)
        self._changes = np.zeros(measured_mm.shape)

    def residual(self, x: Array, rows: Index) -> tuple[Array, Mask]:
        """(R, M); which have an answer."""
        positions, found = self.robots.positions_mm(x, rows)
        measured_mm, whitening = (
            rows_of(each, rows) for each in (self._measured_mm, self._whitening)
        )
        if self.robots.kernel is not None:
            of_pairs = self._first, self._second, measured_mm, whitening
            return self.robots.kernel.distance_residuals(positions, *of_pairs), found
        lengths = np.linalg.norm(self._between(positions), axis=1)
        return whitening * (lengths - measured_mm), found

    def step(self, x: Array, residual: Array, rows: Index) -> tuple[Array, Array, Mask]:
        """Step of Gauss-Newton from residuals (R, M), as `normal_step`."""
        if self.robots.kernel is None:
            jacobian = self.jacobian(x, rows)
            step, length, regular = normal_step(jacobian, residual)
        else:
            jacobian, step, length, regular, changes = self._compiled(x, residual, rows)
            self._changes = with_rows(self._changes, rows, changes)
        self._jacobians = with_rows(self._jacobians, rows, jacobian)
        return step, length, regular

    def change(self, step: Array, rows: Index) -> Array:
        """Change (R, M) of residuals by last steps (R, F)."""
        if self.robots.kernel is not None:
            return rows_of(self._changes, rows)
        return product(rows_of(self._jacobians, rows), step)

    def last_jacobians(self, x: Array, rows: Index) -> Array:  # noqa: ARG002 - as of points
        """Jacobians (R, M, F) from which steps were last taken."""
        return rows_of(self._jacobians, rows)

    def jacobian(self, x: Array, rows: Index) -> Array:
        """Derivatives by parameters, (R, M, F)."""
        if self.robots.kernel is not None:
            return self._compiled(x, np.empty((0, len(self._first))), rows)[0]
        positions, by_x = self.robots.jacobian(x, rows)
        between = self._between(positions)
        lengths = np.maximum(np.linalg.norm(between, axis=1), TINY_MM)
        along = (between * (rows_of(self._whitening, rows) / lengths)[:, None]).swapaxes(0, 1)
        columns = sum(a * b for a, b in zip(along, self._between(by_x), strict=True))
        return np.ascontiguousarray(np.swapaxes(columns, 0, 1)).swapaxes(1, 2)

    def _compiled(
        self, x: Array, residual: Array, rows: Index
    ) -> tuple[Array, Array, Array, Mask, Array]:
        """Jacobians (R, M, F) and, from residuals (R, M) if there are any, `step` and `change`."""
        assert self.robots.kernel is not None, "asked for where there is one"
        pairs = self._first, self._second, rows_of(self._whitening, rows), residual
        closed = self.robots.closed_at(x, rows)
        jacobians, *of_step = self.robots.kernel.distance_jacobians(closed, *pairs)
        step, length, regular, changes = of_step
        return jacobians.swapaxes(1, 2), step, length, regular, changes

    def _between(self, each: Array) -> Array:
        """From first to second shots, (…, M) of (…, N)."""
        return np.asarray(each[..., self._second] - each[..., self._first])
