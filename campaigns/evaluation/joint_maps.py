"""Joints that count from another zero or in another unit: an affine map for each, fitted to points.

Encoders are set to zero at a homing switch, controllers count steps, and motors turn behind gears.
So joints are read as factor · reading + zero, and both are fitted so that the nominal robot has the
measured points at these joints, up to a rigid motion:

1. Starts lie on a grid: readings as they are, or with any spread, and zeros all around. Their
   misfits decide which of them are refined.
2. Maps are refined by least squares, in which a few gross errors count little, from the simplest
   on: one factor, one zero, a zero for each joint, one factor and one zero, both for each joint.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from campaigns.arrays import Array
from campaigns.evaluation.readings import greater_part, similarity
from campaigns.kinematics.axes import Axis
from campaigns.kinematics.model import Kinematics

CENTRES = np.linspace(-1.0, 1.0, 13)[1:]
"""Means of joints on the grid, in half turns, or in `REACH` times the points' spread: the fit
converges from half of their distance."""
REACH = 6.0
SPREADS = (0.1, 0.2, 0.4, 0.8)
"""Spreads of joints on the grid, in rad, or in times the points' spread."""
STARTS = 2
"""Starts that are refined for each kind of map."""
OUTLIER = 0.1
"""Residual in parts of the points' spread from which on a shot counts less."""
MOST_STEPS = 15
LEAST_WEIGHT = 1e-3
"""Weight of zeros against residuals."""


@dataclass(frozen=True, slots=True, eq=False)
class JointMap:
    """Affine map of readings to joints, and what it leaves."""

    factors: Array
    """Joint per reading (n,)."""
    zeros: Array
    """Joint at the reading 0, (n,), rad or mm."""
    misfit: float
    """Residual of the greater part of the shots, in parts of the points' spread."""


def simplest_map(
    nominal: Kinematics, readings: Array, points: Array, limit: float
) -> JointMap | None:
    """Return the simplest map that explains readings (N, n) and points (N, 3); None if none does.

    Its misfit is half of the limit at most, or else it is within the limit, and another one has
    half of it at best: more parameters explain the robot's errors, too.
    """
    maps = []
    for joint_map in fitted_maps(nominal, readings, points):
        if joint_map.misfit <= limit / 2.0:
            return joint_map
        maps.append(joint_map)
    alike = min(limit, 2.0 * min(joint_map.misfit for joint_map in maps))
    return next((joint_map for joint_map in maps if joint_map.misfit <= alike), None)


def fitted_maps(nominal: Kinematics, readings: Array, points: Array) -> Iterator[JointMap]:
    """Yield the best map of each kind for readings (N, n) and points (N, 3), the simplest first."""
    shots = _Shots(nominal, readings, points)
    grid = shots.grid()
    misfits = np.linalg.norm(shots.residuals(grid), axis=(1, 2))
    # of maps that fit alike, as those of upright rails do, the one with the least zeros comes first
    order = np.lexsort((np.linalg.norm(grid[:, readings.shape[1] :], axis=1), misfits.round(2)))
    for basis, origin in _kinds(readings.shape[1]):
        # the best maps of the grid that are of this kind
        coordinates = (grid[order] - origin) @ np.linalg.pinv(basis).T
        is_of_kind = np.isclose(coordinates @ basis.T + origin, grid[order]).all(axis=1)
        starts = coordinates[is_of_kind][:STARTS]
        maps = [shots.refined(start, basis, origin) for start in starts]
        yield min(maps, key=lambda joint_map: joint_map.misfit)


def map_in_words(joint_map: JointMap, axes: Sequence[Axis]) -> tuple[str, str]:
    """Return cause and remedy for joints that are to be read by a map."""
    columns = ", ".join(axis.column for axis in axes)
    factors, zeros = joint_map.factors.tolist(), joint_map.zeros.tolist()
    in_file = [axis.to_file(zero) for axis, zero in zip(axes, zeros, strict=True)]
    turned = " and have the other sign" if max(factors) < 0.0 else ""
    # 1. One factor alone
    if not any(zeros):
        times = 1.0 / factors[0]
        cause = f"the joints seem to be {abs(times):.4g} times too large{turned}"
        return f"{cause}: steps, turns or another unit", f"divide {columns} by {times:.4g}"
    # 2. Zeros, with factors or without
    remedy = "write " + ", ".join(
        f"{_factor(factor)}{axis.column} {'-' if zero < 0.0 else '+'} {abs(zero):.4g}"
        for axis, factor, zero in zip(axes, factors, in_file, strict=True)
    )
    remedy += f" as {columns}"
    if not all(abs(factor) == 1.0 for factor in factors):
        return "the joints seem to be in another unit and to count from another zero", remedy
    listed = ", ".join(
        f"{zero:+.4g}{'°' if axis.is_revolute else ' mm'}"
        for axis, zero in zip(axes, in_file, strict=True)
    )
    return f"the joints seem to count from another zero ({listed}){turned}", remedy


def _factor(factor: float) -> str:
    return {1.0: "", -1.0: "-"}.get(factor, f"{factor:.4g} * ")


def _kinds(count: int) -> Iterator[tuple[Array, Array]]:
    """Yield basis (2n, k) and origin (2n,) of each kind of map: factors, then zeros of n joints."""
    nothing, alike = np.zeros((count, count)), np.ones((count, 1))
    written = np.r_[np.ones(count), np.zeros(count)]
    factor, zero = np.r_[alike, 0.0 * alike], np.r_[0.0 * alike, alike]
    yield factor, 0.0 * written
    for basis in (zero, np.r_[nothing, np.eye(count)]):
        yield basis, written
        yield basis, -written
    yield np.c_[factor, zero], 0.0 * written
    yield np.eye(2 * count), 0.0 * written


@dataclass(frozen=True, slots=True, eq=False)
class _Shots:
    """Readings (N, n) of joints, and the points (N, 3) that the nominal robot should have there."""

    nominal: Kinematics
    readings: Array
    points: Array

    def grid(self) -> Array:
        """Return factors and zeros of maps all over, (G, 2n), the same for all joints of a kind."""
        # Joints of one kind are alike: their readings have one mean and one spread.
        turns = np.array([axis.is_revolute for axis in self.nominal.mechanism.joints])
        unit = self._units()
        reach = np.where(turns, np.pi, REACH * unit)
        mean, spread = np.empty(len(turns)), np.empty(len(turns))
        for kind in {*turns.tolist()}:
            of_kind = self.readings[:, turns == kind]
            mean[turns == kind] = of_kind.mean()
            spread[turns == kind] = of_kind.std() or 1.0
        sizes = [np.ones(len(turns)), *(share * unit / spread for share in SPREADS)]
        maps = [
            np.r_[sign * size, centre - sign * size * mean]
            for sign in (1.0, -1.0)
            for size in sizes
            for centre in (sign * size * mean, *np.outer(CENTRES, reach))
        ]
        return np.array(maps)

    def residuals(self, maps: Array) -> Array:
        """Return the residuals (G, N, 3) of maps (G, 2n), in parts of the points' spread.

        A shot that the robot cannot take counts as if it was in the middle of the others.
        """
        count = self.readings.shape[1]
        joints = maps[:, None, :count] * self.readings + maps[:, None, count:]
        solution = self.nominal.forward(joints.reshape(-1, count))
        positions = self.nominal.points(solution.values).reshape(*joints.shape[:2], -1)
        rows, residuals = np.arange(len(self.points)), []
        for of_map in positions:
            is_solved = np.isfinite(of_map).all(axis=1)
            middle = of_map[is_solved].mean(axis=0) if is_solved.any() else np.zeros(3)
            modelled = np.where(is_solved[:, None], of_map, middle)
            residuals.append(similarity(modelled, self.points, rows, scaled=False)[1])
        return np.array(residuals) / self._size()

    def refined(self, start: Array, basis: Array, origin: Array) -> JointMap:
        """Return the map near the coordinates `start` (k,) of its kind that fits best."""

        def residuals(coordinates: Array) -> Array:
            # zeros that make no difference, as along upright rails, stay small
            maps = (basis @ coordinates + origin)[None]
            small = LEAST_WEIGHT * maps[0, self.readings.shape[1] :] / self._units()
            return np.concatenate([self.residuals(maps).ravel(), small])

        fitted = scipy.optimize.least_squares(
            residuals, start, x_scale="jac", loss="soft_l1", f_scale=OUTLIER, max_nfev=MOST_STEPS
        )
        factors, zeros = np.split(basis @ fitted.x + origin, 2)
        return JointMap(factors, zeros, self._misfit(factors, zeros))

    def _misfit(self, factors: Array, zeros: Array) -> float:
        solution = self.nominal.forward(factors * self.readings + zeros)
        solved = solution.is_solved
        if np.count_nonzero(solved) < len(solved):
            return float("inf")
        positions = self.nominal.points(solution.values)
        rows = greater_part(positions, self.points, scaled=False)
        _, residuals = similarity(positions, self.points, rows, scaled=False)
        return float(np.sqrt(np.mean(np.sum(residuals[rows] ** 2, axis=1)))) / self._size()

    def _units(self) -> Array:
        """Return a joint's usual size (n,): 1 rad, or the points' spread."""
        axes = self.nominal.mechanism.joints
        return np.array([1.0 if axis.is_revolute else self._size() for axis in axes])

    def _size(self) -> float:
        """Return the points' spread: the root mean square of their distances from their middle."""
        apart = self.points - self.points.mean(axis=0)
        return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))
