"""Plate tilt by unequal rods and tilted axes: what no contracted parallelogram can express.

Forearm i is two rods between the ends of an elbow bar and of a plate bar, both of half width w.
With g the vector from the middle of the elbow bar to that of the plate bar, e = R v - a the
difference of the bars' directions (v: plate bar on a level plate, a: motor axis, R: plate's
rotation) and rods of lengths L ± κ w, the rods close where

    sum of the squares        |g|² = L²           (- w² |e|² + w² κ², of second order, left out)
    difference of the squares g · e = κ L

independent of w. The sums are the contracted closures with plate joints moved by the tilt; the
differences give the tilt: as many equations as arms for three unknowns, solved in the sense of
least squares weighted by the level plate's sensitivities, exactly with three arms.
Derivation: docs/model.md, "Plate tilt".

Arrays of all arms lie by component and arm, (3, n, N). A rotation is a Gibbs vector s, (3, N), the
tangent of half its angle along its axis; derivatives are by a further small turn φ in the base
frame, d(R c) = φ × R c.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Self

import numpy as np

from campaigns.arrays import Array

Place = tuple[float, float, float]
TYPICAL_JOINT_MM = 50.0
DIAGONAL = np.arange(3), np.arange(3)
NEXT, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
"""The component after each of x, y, z, and the one after that."""
MINORS = tuple(combinations(range(4), 2))
"""Columns of which minors are formed, in their order."""
COFACTORS = (
    ((1, 5), (2, 4), (3, 3)),
    ((0, 5), (2, 2), (3, 1)),
    ((0, 4), (1, 2), (3, 0)),
    ((0, 3), (1, 1), (2, 0)),
)
"""Of each row of an inverse: components of a row of the system, and which minor goes with each."""
ROUNDS = 15
SETTLED_RAD = 1e-13
"""Last step of a tilt, a thousandth of which is left."""


@dataclass(frozen=True)
class PlateGeometry:
    """Nominal places on the plate in the base frame, of a level plate at θ = 0."""

    joints_mm: tuple[Place, ...]
    """b_i: the plate bars' middles, seen from the contracted B_i, where perfect parts have them."""
    reflector_mm: Place
    """r: the measured point, seen from the controlled one."""
    outward_rad: tuple[float, ...] | None = None
    """Azimuths across the plate's bars; None: the arms'."""

    @classmethod
    def typical(cls, outward_rad: Array, *, follows_arms: bool) -> Self:
        """Geometry where none is given: joints `TYPICAL_JOINT_MM` outward, the point between."""
        outward_mm = TYPICAL_JOINT_MM * np.stack([np.cos(outward_rad), np.sin(outward_rad)], axis=1)
        joints_mm = tuple((float(x), float(y), 0.0) for x, y in outward_mm)
        fixed = None if follows_arms else tuple(outward_rad.tolist())
        return cls(joints_mm, (0.0, 0.0, 0.0), fixed)

    @cached_property
    def from_reflector_mm(self) -> Array:
        """b_i - r, (3, n, 1)."""
        seen_mm = np.array(self.joints_mm) - np.array(self.reflector_mm)
        return np.asarray(seen_mm.T[..., None])

    def seen_mm(self, offsets_mm: Array) -> Array:
        """Plate joints seen from the reflector, (3, n, N), of contracted offsets B_i - X."""
        return np.asarray(offsets_mm + self.from_reflector_mm)


@dataclass(frozen=True, eq=False)
class RodPairs:
    """Directions of the bars and skews that tilt the plate, of all arms."""

    plate_bars: Array
    """v_i (3, n, 1): horizontal, across the arm."""
    motor_axes: Array
    """a_i (3, n, 1): v_i turned by the axis tilt."""
    skew: Array
    """κ_i (n, 1): half the difference of the rods' lengths over half their parallelogram's
    width."""
    forearm_mm: Array
    """L_i (n, 1)."""

    @classmethod
    def of(cls, azimuths_rad: Array, tilts_rad: Array, skew: Array, forearm_mm: Array) -> Self:
        """Pairs of rods by azimuths, axis tilts, skews and forearm lengths, (n, 1) each."""
        level = np.zeros_like(azimuths_rad)
        bars = np.stack([-np.sin(azimuths_rad), np.cos(azimuths_rad), level])
        axes = np.cos(tilts_rad) * bars
        axes[2] = np.sin(tilts_rad)
        return cls(bars, axes, skew, forearm_mm)

    @cached_property
    def are_level(self) -> bool:
        """Whether rods and axes are perfect, which leaves the plate level everywhere."""
        return not (self.skew.any() or self.motor_axes[2].any())

    @cached_property
    def bars(self) -> Array:
        """Horizontal components of v_i / L_i, (2, n, 1)."""
        return np.asarray(self.plate_bars[:2] / self.forearm_mm)

    @cached_property
    def rises(self) -> Array:
        """Of the vertical component of v_i × y_i / L_i over that of y_i, (2, n, 1)."""
        return np.stack([-self.bars[1], self.bars[0]])

    @cached_property
    def axes(self) -> Array:
        """a_i / L_i, (3, n, 1)."""
        return np.asarray(self.motor_axes / self.forearm_mm)

    @cached_property
    def axes_by_tilt(self) -> Array:
        """Derivatives of a_i / L_i by the axis tilts, (3, n, 1)."""
        x, y, rise = self.axes
        by_tilt = np.empty_like(self.axes)
        by_tilt[:2], by_tilt[2] = -rise * self.plate_bars[:2], np.hypot(x, y)
        return by_tilt

    @cached_property
    def level_across(self) -> Array:
        """(v_i - a_i) / L_i, (3, n, 1)."""
        return np.asarray((self.plate_bars - self.motor_axes) / self.forearm_mm)

    def tilt(self, forearms_mm: Array, seen_mm: Array, start: Array | None = None) -> Array:
        """Gibbs vectors (3, N) of the plate, of contracted forearms and plate joints (3, n, N)."""
        gibbs = np.zeros((3, forearms_mm.shape[2])) if start is None else start
        for _ in range(ROUNDS):
            gibbs, step = self.approached(forearms_mm, seen_mm, gibbs)
            if not np.abs(step).max(initial=0.0) > SETTLED_RAD:
                break
        return gibbs

    def approached(self, forearms_mm: Array, seen_mm: Array, gibbs: Array) -> tuple[Array, Array]:
        """Gibbs vectors (3, N) some thousand times nearer to the plate's, and the step, rad."""
        state = self.state(forearms_mm, seen_mm, gibbs)
        weights = state.weights
        matrix = np.einsum("kin,lin->kln", weights, weights)
        step = _solved(matrix, -state.normal_equations())
        return turned_further(gibbs, step), step

    def state(self, forearms_mm: Array, seen_mm: Array, gibbs: Array) -> "TiltedForearms":
        """Forearms of the tilted plate, with what its normal equations need."""
        r_minus_i = rotation_minus_identity(gibbs)
        moved_mm = applied(r_minus_i, seen_mm)
        forearms_mm = forearms_mm + moved_mm
        across = applied(r_minus_i, self.bars) + self.level_across
        misfit = dot(forearms_mm, across) - self.skew
        joints_mm, weights = seen_mm + moved_mm, self.crossed(forearms_mm)
        return TiltedForearms(self, r_minus_i, joints_mm, forearms_mm, across, misfit, weights)

    def crossed(self, vectors: Array) -> Array:
        """v_i × y_i / L_i, (3, n, N), of vectors y (3, n, N): bars are horizontal."""
        product = np.empty_like(vectors)
        np.multiply(self.rises, -vectors[2], out=product[:2])
        np.einsum("kin,kin->in", self.rises, vectors[:2], out=product[2])
        return product


@dataclass(frozen=True, slots=True, eq=False)
class TiltedForearms:
    """Forearms g_i of a tilted plate, and the misfits of the differences of their rods."""

    pairs: RodPairs
    r_minus_i: Array
    """R - 1, (3, 3, N)."""
    joints_mm: Array
    """Plate joints seen from the measured point (3, n, N)."""
    forearms_mm: Array
    """g_i (3, n, N)."""
    across: Array
    """e_i / L_i, of e_i = R v_i - a_i, (3, n, N)."""
    misfit: Array
    """g_i·e_i / L_i - κ_i (n, N)."""
    weights: Array
    """v_i × g_i / L_i (3, n, N): how a tilt moves a misfit, to first order."""

    def closures(self) -> Array:
        """|g_i|² - L_i² (n, N), zero at the plate's pose."""
        return np.asarray(dot(self.forearms_mm, self.forearms_mm) - self.pairs.forearm_mm**2)

    def normal_equations(self) -> Array:
        """Σ weights · misfit (3, N), zero at the plate's tilt."""
        return np.asarray(np.einsum("kin,in->kn", self.weights, self.misfit))

    def rotated(self, vectors: Array) -> Array:
        """R y, (3, n, N), of vectors y (3, n, N)."""
        return np.asarray(vectors + applied(self.r_minus_i, vectors))

    def by_pose_and_turn(self, by_turn_of_half: Array | None) -> tuple[Array, Array]:
        """Derivatives of closures (t + 3, n, N) and normal equations (3, t + 3, N).

        By the pose, then by φ. `by_turn_of_half` (3, n, N) are those of the plate joints by the
        pose's own turn, where it has one.
        """
        tasks = 3 if by_turn_of_half is None else 4
        forearms, across, joints = self.forearms_mm, self.across, self.joints_mm
        closures = np.empty((tasks + 3, *self.misfit.shape))
        misfits, rises = np.empty_like(closures), self.misfit * self.pairs.rises
        closures[:3], misfits[:3] = forearms, across
        closures[tasks:] = cross(joints, forearms)  # φ × R c moves a joint
        misfits[tasks:] = cross(joints, across) + cross(across + self.pairs.axes, forearms)
        if by_turn_of_half is not None:
            closures[3], misfits[3] = dot(by_turn_of_half, forearms), dot(by_turn_of_half, across)
        closures *= 2.0
        normal = np.einsum("kin,min->kmn", self.weights, misfits)
        # weights move too, by v × their joints' motions; v × φ × R c = φ (v·R c) - R c (v·φ)
        by_place = rises.sum(axis=1)
        normal[2, :2] += by_place
        normal[:2, 2] -= by_place
        turned = np.einsum("kin,lin->lkn", joints, rises)
        normal[:, tasks] -= turned[1]
        normal[:, tasks + 1] += turned[0]
        normal[:, tasks:][DIAGONAL] += turned[1, 0] - turned[0, 1]
        if by_turn_of_half is not None:
            normal[:2, 3] -= np.einsum("lin,in->ln", rises, by_turn_of_half[2])
            normal[2, 3] += np.einsum("lin,lin->n", rises, by_turn_of_half[:2])
        return closures, normal

    def sensitivities(self, by_closure: Array, by_normal: Array) -> tuple[Array, Array]:
        """Derivatives of task coordinates by misfits (t, n, N), and half those by forearms.

        The latter are (3, t, n, N), from those by closures (t, n, N) and normal equations
        (t, 3, N).
        """
        by_misfit = np.einsum("tkn,kin->tin", by_normal, self.weights)
        by_forearm, part = self.across[:, None] * by_misfit, np.empty_like(by_misfit)
        for axis, rises in enumerate(self.misfit * self.pairs.rises):
            by_forearm[axis] += np.multiply(rises, by_normal[:, 2, None], out=part)
            by_forearm[2] -= np.multiply(rises, by_normal[:, axis, None], out=part)
        by_forearm *= 0.5
        for axis, forearms_mm in enumerate(self.forearms_mm):
            by_forearm[axis] += np.multiply(forearms_mm, by_closure, out=part)
        return by_misfit, by_forearm

    def by_azimuths(self, by_misfit: Array, by_normal: Array) -> Array:
        """Derivatives of task coordinates by the bars' azimuths, elbows held, (t, n, N).

        From those by misfits and normal equations.
        """
        axes, turned = self.pairs.motor_axes, self.pairs.rises
        level = np.hypot(axes[0], axes[1])
        across = applied(self.r_minus_i, turned)
        across[:2] += turned * (1.0 - level)
        (turned_x, turned_y), (x, y, z) = self.misfit * turned, self.forearms_mm
        weighted = np.stack([turned_y * z, -turned_x * z, turned_x * y - turned_y * x])
        azimuth = by_misfit * dot(self.forearms_mm, across)
        return np.asarray(azimuth + np.einsum("tkn,kin->tin", by_normal, weighted))

    def by_own_parameters(self, by_misfit: Array) -> tuple[Array, ...]:
        """Derivatives of task coordinates by forearm, axis tilt and skew, elbows held.

        (t, n, N) each, but for what closures do; from those by misfits.
        """
        pairs, by_skew = self.pairs, -by_misfit
        return (
            by_skew * ((2.0 * self.misfit + pairs.skew) / pairs.forearm_mm),
            by_skew * dot(self.forearms_mm, pairs.axes_by_tilt),
            by_skew,
        )


def rotation_minus_identity(gibbs: Array) -> Array:
    """R - 1 (3, 3, N) of Gibbs vectors (3, N)."""
    (x, y, z), square = gibbs, (gibbs * gibbs).sum(axis=0)
    r_minus_i = gibbs[:, None] * gibbs
    r_minus_i.reshape(9, -1)[::4] -= square  # the diagonal
    for (row, column), turn in (((2, 1), x), ((0, 2), y), ((1, 0), z)):
        r_minus_i[row, column] += turn
        r_minus_i[column, row] -= turn
    r_minus_i *= 2.0 / (1.0 + square)
    return np.asarray(r_minus_i)


def applied(matrices: Array, vectors: Array) -> Array:
    """Products (3, n, N) of matrices (3, 3, N) and vectors (3, n, N) or (3, n, 1).

    Horizontal vectors may lack their third component.
    """
    return np.asarray(np.einsum("kln,lin->kin", matrices[:, : len(vectors)], vectors))


def displacement(gibbs: Array, vectors: Array) -> Array:
    """(R - 1) c, (3, n, N), of vectors c (3, n, N) on a plate turned by Gibbs vectors s (3, N)."""
    return applied(rotation_minus_identity(gibbs), vectors)


def rotation_vectors(gibbs: Array) -> Array:
    """Rotation vectors (3, N), rad, of Gibbs vectors."""
    size = np.linalg.norm(gibbs, axis=0)
    # 2 atan(x) / x is 2 where x vanishes, and smooth there
    ratio = np.where(size > 0.0, 2.0 * np.arctan(size) / np.where(size > 0.0, size, 1.0), 2.0)
    return np.asarray(ratio * gibbs)


def inverse_of_three(matrices: Array) -> Array:
    """Inverses (3, 3, N) of systems (3, 3, N), by row: columns over the determinant.

    Raises `LinAlgError` for a singular one.
    """
    of_columns = matrices.swapaxes(0, 1)
    inverse = cross(of_columns.take(NEXT, axis=1), of_columns.take(LAST, axis=1))
    return np.asarray(inverse / _regular(dot(matrices[0], inverse[:, 0])))


def inverse_of_four(matrices: Array) -> Array:
    """Inverses (4, 4, N) of systems (4, 4, N), by the minors of the first and last two rows.

    Several times faster than a batched call; raises `LinAlgError` for a singular one.
    """
    rows = np.ascontiguousarray(matrices).reshape(2, 2, 4, -1)
    minors, product = np.empty((6, 2, rows.shape[-1])), np.empty((2, rows.shape[-1]))
    for place, (i, j) in enumerate(MINORS):
        np.multiply(rows[:, 0, i], rows[:, 1, j], out=minors[place])
        minors[place] -= np.multiply(rows[:, 0, j], rows[:, 1, i], out=product)
    (s01, t01), (s02, t02), (s03, t03), (s12, t12), (s13, t13), (s23, t23) = minors
    whole = s01 * t23 - s02 * t13 + s03 * t12 + s12 * t03 - s13 * t02 + s23 * t01
    minors *= 1.0 / _regular(whole)
    inverse, part = np.empty((4, 2, 2, rows.shape[-1])), np.empty((2, 2, rows.shape[-1]))
    others, beyond = rows[:, ::-1].transpose(2, 0, 1, 3), minors[:, ::-1, None]
    for row, ((first, a), (second, b), (third, c)) in enumerate(COFACTORS):
        np.multiply(others[first], beyond[a], out=inverse[row])
        inverse[row] -= np.multiply(others[second], beyond[b], out=part)
        inverse[row] += np.multiply(others[third], beyond[c], out=part)
    inverse[1::2] *= -1.0
    inverse[:, :, 1] *= -1.0
    return inverse.reshape(4, 4, -1)


def _regular(determinant: Array) -> Array:
    """Determinants (N,) of what has an inverse; else raises `LinAlgError`."""
    if not determinant.all():
        raise np.linalg.LinAlgError("a singular matrix has no inverse")
    return determinant


def turned_further(gibbs: Array, turn_rad: Array) -> Array:
    """Gibbs vectors of rotations followed by small turns (their Gibbs vectors half as long)."""
    half = 0.5 * turn_rad
    return np.asarray((gibbs + half + cross(half, gibbs)) / (1.0 - dot(half, gibbs)))


def dot(a: Array, b: Array) -> Array:
    """Scalar products of vectors by component, (3, …)."""
    return np.asarray(np.einsum("k...,k...->...", a, b))


def cross(a: Array, b: Array) -> Array:
    """Vector products of vectors by component, (3, …)."""
    first = a[1] * b[2]
    product = np.empty((3, *first.shape))
    np.subtract(first, a[2] * b[1], out=product[0])
    np.subtract(a[2] * b[0], a[0] * b[2], out=product[1])
    np.subtract(a[0] * b[1], a[1] * b[0], out=product[2])
    return product


def _solved(matrices: Array, right: Array) -> Array:
    """Solutions (3, N) of symmetrical systems (3, 3, N)."""
    a, b, c = matrices
    bc, ca, ab = cross(b, c), cross(c, a), cross(a, b)
    return np.asarray((right[0] * bc + right[1] * ca + right[2] * ab) / dot(a, bc))
