"""Information: the standard uncertainty of parameters and positions, the one place that forms it.

Jacobian of what is measured → whitened → frame marginalised → covariance, times the variance
factor. Plans, runs, identification, corrected targets and studies take every σ from here.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import scipy

from campaigns.arrays import Array, Index, Mask
from campaigns.estimation.f_test import FittedShots
from campaigns.estimation.observability import (
    RANK_TOLERANCE,
    Observability,
    observability,
    project_out_nuisance,
    triangle_of,
)
from campaigns.estimation.point_sets import directions
from campaigns.estimation.residuals import (
    FRAME_COLUMNS,
    DistanceResiduals,
    PointResiduals,
    PositionModel,
)
from campaigns.estimation.rigid_transforms import Transform
from campaigns.estimation.tracker_noise import inverse_roots
from campaigns.mechanisms.mechanism import Kinematics, NoSolution

SIGNIFICANCE = 1e-3
"""A χ² that good noise exceeds or falls below less often than this is not consistent with it."""
EXACT = 1e-5
"""σ: misfits below it are rounding, which has patterns of its own."""
CONFIDENCE = 0.95
MINIMUM_DOF = 12
"""Degrees of freedom below which a Birge ratio, known to ± 20 % by so many, is not relied on."""
STATED_DOF = 12
"""Degrees of freedom that the stated noise is worth where residuals tell their own variance: as a
prior it is taken to be known to ± 20 %."""
LEAST_SHARE = 0.1
"""Of a workspace's poses: fewer do not speak for it."""


@dataclass(frozen=True, slots=True)
class ChiSquareTest:
    """Test of the stated noise by χ², and the scale of every σ that follows from it."""

    chi2: float
    dof: int
    p: float | None
    """Chance of good noise to lie as far out, on either side; None without degrees of freedom."""
    sigma0: float | None
    """Square root of the variance factor, which multiplies every σ; None where nothing tells it."""

    @property
    def consistent(self) -> bool | None:
        """Consistency: the measurements scatter as stated; None: there is nothing to tell by."""
        return None if self.p is None else self.p >= SIGNIFICANCE

    @property
    def beyond(self) -> bool:
        """Whether it is more than chance explains."""
        return self.p is not None and bool(is_beyond_chance(self.chi2, self.dof))

    @property
    def birge_ratio(self) -> float | None:
        """√(χ²/ν): scatter over stated scatter; None without degrees of freedom."""
        return float(np.sqrt(self.chi2 / self.dof)) if self.dof > 0 else None

    @property
    def widening(self) -> float:
        """Factor of stated σ for what is measured again: the scatter, never less than stated."""
        return max(1.0, self.birge_ratio or 1.0)


def chi_square_test(chi2: float, dof: int, sigma0: float | None = None) -> ChiSquareTest:
    """Test with the two-sided probability of such a χ²."""
    if dof < 1:
        return ChiSquareTest(chi2, dof, None, sigma0)
    p = 2.0 * min(float(scipy.special.chdtr(dof, chi2)), float(scipy.special.chdtrc(dof, chi2)))
    return ChiSquareTest(chi2, dof, min(p, 1.0), sigma0)


def is_beyond_chance(chi2: Array | float, dof: Index | int) -> Mask:
    """Whether each χ² (…) of so many degrees of freedom (…) is more than chance explains."""
    return np.asarray((chi2 > dof) & (2.0 * scipy.special.chdtrc(dof, chi2) < SIGNIFICANCE))


def variance_scale(
    scatter: float | None, tested: ChiSquareTest, *, known_variance: bool
) -> float | None:
    """Scale of every σ, the one policy for the variance factor; None where nothing tells it.

    `scatter` is that of the whitened residuals. Where the stated variance counts as known, σ come
    from it until a test of χ² rejects it, and then from the scatter, but never smaller. Elsewhere σ
    come from the scatter, with the stated variance as a prior of `STATED_DOF` degrees of freedom
    (scaled inverse χ²) until the test rejects it.
    """
    if not known_variance:
        if scatter is None or not tested.consistent:
            return scatter
        pooled = (STATED_DOF + tested.dof * scatter**2) / (STATED_DOF + tested.dof)
        return float(np.sqrt(pooled))
    if scatter is None or variance_is_stated(tested, known_variance=known_variance):
        return 1.0
    return max(1.0, scatter)


def variance_is_stated(tested: ChiSquareTest, *, known_variance: bool) -> bool:
    """Whether σ come from the stated variance, whatever the residuals scatter."""
    return known_variance and tested.consistent is True


def variance_dof(tested: ChiSquareTest, *, known_variance: bool) -> int | None:
    """Degrees of freedom by which `variance_scale` knows the variance; None: it counts as known."""
    if known_variance and (tested.sigma0 is None or tested.sigma0 <= 1.0):
        return None
    prior = STATED_DOF if tested.consistent and not known_variance else 0
    return max(tested.dof, 1) + prior


def coverage_factor(dof: int | None) -> float:
    """Half-width of a 95 % interval in stated standard deviations.

    Student's where the variance was estimated with so many degrees of freedom, normal (None) where
    it is known.
    """
    tail = 0.5 * (1.0 + CONFIDENCE)
    return float(scipy.special.ndtri(tail) if dof is None else scipy.special.stdtrit(dof, tail))


def covariance(jacobian: Array) -> Array:
    """(JᵀJ)⁻¹ by QR, for residuals of unit variance, (…, P, P), of Jacobians (…, M, P).

    Raises `LinAlgError` when the rank of one is lost.
    """
    norms = np.linalg.norm(jacobian, axis=-2)
    scaled = jacobian / np.where(norms > 0.0, norms, 1.0)[..., None, :]
    one = scaled.ndim == 2
    triangle = triangle_of(scaled) if one else np.asarray(np.linalg.qr(scaled, mode="r"))
    return covariance_of_triangle(triangle, norms)


def covariance_of_triangle(triangle: Array, norms: Array) -> Array:
    """The same of the triangle (…, P, P) of the Jacobian's columns over their norms (…, P)."""
    count, pivots = triangle.shape[-1], np.abs(np.diagonal(triangle, axis1=-2, axis2=-1))
    if pivots.min(initial=np.inf) > RANK_TOLERANCE:
        inverse = np.linalg.inv(triangle)
        condition = np.linalg.norm(triangle, axis=(-2, -1)) * np.linalg.norm(inverse, axis=(-2, -1))
        is_known = bool((condition < 1.0 / RANK_TOLERANCE).all())  # spreads are no farther apart
    else:
        is_known = False
    if not is_known:
        spread = np.linalg.svd(triangle, compute_uv=False)
        rank = int(np.sum(spread > RANK_TOLERANCE * spread[..., :1], axis=-1).min())
        if rank < count:
            raise np.linalg.LinAlgError(f"rank {rank} of {count}: no finite covariance")
        inverse = np.linalg.inv(triangle)
    root = inverse / norms[..., None]
    return np.asarray(root @ root.swapaxes(-1, -2))


def common_changes(jacobian: Array, covariance_matrix: Array, sigma0: float, shift: Array) -> Array:
    """Changes of the unknowns, (P,), when all that was measured shifts, (M,).

    Jacobian (M, P) and shift are whitened as for the fit whose covariance it is, times σ0².
    """
    return np.asarray(covariance_matrix @ (jacobian.T @ shift) / sigma0**2)


def column_effect(fit: FittedShots, columns: Array) -> tuple[Array, Array, float]:
    """Sizes (k,) of columns (N, 3, k) beside a fit of unit variance, covariance and gain in χ²."""
    beside = fit.beside(columns)
    matrix = np.asarray(np.linalg.pinv(beside.T @ beside, rcond=1e-10, hermitian=True))
    told = beside.T @ fit.left
    return matrix @ told, matrix, float(told @ matrix @ told)


def point_jacobian(
    kinematics: Kinematics,
    free: tuple[str, ...],
    joints: Array,
    poses: Array,
    approach: Array | None = None,
) -> Array:
    """∂(point in a frame to be estimated)/∂(free parameters, frame), (N, 3, F + 6), mm and rad."""
    places = _places(kinematics, free)
    model = PositionModel(kinematics, places, joints, poses, approach=approach)
    unturned = Transform(np.eye(3), np.zeros(3))
    points, whitening = np.zeros((len(poses), 3)), np.broadcast_to(np.eye(3), (len(poses), 3, 3))
    problem = PointResiduals(model, points, whitening, unturned)
    return problem.jacobian(problem.start()).reshape(len(poses), 3, -1)


def distance_jacobian(
    kinematics: Kinematics, free: tuple[str, ...], joints: Array, poses: Array, pairs: Index
) -> Array:
    """∂(distance of each pair)/∂(free parameters), (M, F), mm and rad."""
    model = PositionModel(kinematics, _places(kinematics, free), joints, poses)
    problem = DistanceResiduals.in_mm(model, pairs[:, 0], pairs[:, 1], np.zeros(len(pairs)))
    return problem.jacobian(problem.start())


def whitened(jacobian: Array, covariance_mm2: Array) -> Array:
    """Jacobian (N, 3, P) of points in units of their covariances (N, 3, 3)."""
    return np.asarray(inverse_roots(covariance_mm2) @ jacobian)


def marginalise_frame(jacobian: Array) -> Array:
    """Jacobian (N, 3, F + 6) of points after the best fit of their frame, (N, 3, F)."""
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    left = project_out_nuisance(flat, flat.shape[1] - FRAME_COLUMNS)
    return left.reshape(len(jacobian), jacobian.shape[1], -1)


def position_std_mm(jacobian: Array, covariance_matrix: Array) -> Array:
    """Root of the summed variances of X, Y and Z where a Jacobian (N, 3, P) looks, (N,).

    With `point_jacobian` and the covariance of parameters and frame: in the frame that the same
    shots gave. With that of a `WorkspaceSample` and the parameters' alone: after a best fit of it.
    """
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    variance = np.einsum("ij,ij->i", flat @ covariance_matrix, flat)
    return np.asarray(np.sqrt(variance.reshape(len(jacobian), -1).sum(axis=1)))


def length_with_std(vector: Array, covariance_matrix: Array) -> tuple[float, float]:
    """Length of a vector (3,), and its standard uncertainty; of none, in the worst direction."""
    length = float(np.linalg.norm(vector))
    along = vector / length if length > 0.0 else np.linalg.eigh(covariance_matrix)[1][:, -1]
    return length, float(np.sqrt(along @ covariance_matrix @ along))


@dataclass(frozen=True, slots=True, eq=False)
class WorkspaceSample:
    """Sample of poses, and how their positions follow parameters."""

    names: tuple[str, ...]
    jacobian: Array
    """∂position/∂parameters, (N, 3, F), in mm by mm and deg, after a best fit of the frame."""
    poses: Array
    """(N, t)"""
    left_out: int = 0
    """Poses, beside these, that the parameters cannot assemble."""

    @classmethod
    def of(
        cls,
        kinematics: Kinematics,
        names: Sequence[str],
        poses: Array,
        reference: Array | slice | None = None,
        approach: Array | None = None,
    ) -> "WorkspaceSample":
        """Sample of poses (N, t) in the best frame of others (M, t) or some of them, else of all.

        `approach` (N, n) is of poses in their own frame. Raises `NoSolution`.
        """
        free, count = tuple(names), len(names)

        def at(each: Array) -> Array:
            joints = kinematics.inverse(each, approach).values_or_raise()
            return point_jacobian(kinematics, free, joints, each, approach)

        jacobian = at(poses)
        if reference is None:
            jacobian = marginalise_frame(jacobian)
        else:
            others = jacobian[reference] if isinstance(reference, slice) else at(reference)
            flat = others.reshape(-1, count + FRAME_COLUMNS)
            moved = np.linalg.lstsq(flat[:, count:], flat[:, :count], rcond=None)[0]
            jacobian = jacobian[:, :, :count] - jacobian[:, :, count:] @ moved
        return cls(free, jacobian * kinematics.mechanism.parameters.units(free), poses)

    @classmethod
    def of_workspace(
        cls, kinematics: Kinematics, names: Sequence[str], poses: Array
    ) -> "WorkspaceSample | None":
        """Sample of those of a workspace's poses (N, t) that these parameters can assemble.

        None where so few are left that they do not speak for the workspace.
        """
        try:
            return cls.of(kinematics, names, poses)
        except NoSolution:
            there = poses[kinematics.assembles(poses)]
        if len(there) < LEAST_SHARE * len(poses):
            return None
        return replace(cls.of(kinematics, names, there), left_out=len(poses) - len(there))


@dataclass(frozen=True, slots=True)
class Correlation:
    """Correlation of two parameters' errors, from -1 to 1."""

    a: str
    b: str
    value: float


Source = Literal["predicted", "fitted"]
"""By shots as they are stated, or by a fit."""


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Standard uncertainty of parameters, with all that it was formed by."""

    names: tuple[str, ...] = ()
    matrix: tuple[tuple[float, ...], ...] = ()
    """Covariance in the units of the names, mm and deg; infinite where the rank is lost."""
    sigma0: float = 1.0
    """Square root of the variance factor, which every standard uncertainty was multiplied by."""
    dof: int | None = None
    """Degrees of freedom by which the variance is known; None: it counts as known."""
    hold_out_ratio: float = 1.0
    """Factor of the standard uncertainty of positions: 1 while chance explains hold-out pairs."""
    source: Source = "fitted"
    units: tuple[str, ...] = ()
    """Of each name, mm or deg; empty in results of older software."""
    common: dict[str, tuple[float, ...]] = field(default_factory=dict)
    """What all shots have in common and none can tell: by name the change of each parameter by one
    standard deviation of it, mm and deg. `matrix` has no part of it."""

    @classmethod
    def of(
        cls,
        names: Sequence[str],
        units: Array,
        covariance_matrix: Array,
        *,
        sigma0: float = 1.0,
        dof: int | None = None,
        hold_out_ratio: float = 1.0,
        source: Source = "fitted",
        common: Mapping[str, Array] | None = None,
    ) -> "Uncertainty":
        """From a covariance (F, F) in mm and rad; `units` are factors of the names' units, (F,).

        Changes (F,): `common` by what all shots have in common.
        """
        matrix = covariance_matrix / np.outer(units, units)
        rows = tuple(map(tuple, matrix.tolist()))
        words = tuple("mm" if unit == 1.0 else "deg" for unit in units.tolist())
        shared = {name: tuple((each / units).tolist()) for name, each in (common or {}).items()}
        return cls(tuple(names), rows, sigma0, dof, hold_out_ratio, source, words, shared)

    @property
    def array(self) -> Array:
        """Covariance matrix, (F, F), in mm and deg."""
        return np.array(self.matrix).reshape(len(self.names), len(self.names))

    def as_turned_out(self, covariance_matrix: Array) -> Array:
        """A covariance as hold-out pairs show that positions have it."""
        return np.asarray(self.hold_out_ratio**2 * covariance_matrix)

    @property
    def full_rank(self) -> bool:
        """Full rank: every parameter is known."""
        return bool(np.isfinite(self.matrix).all())

    def only(self, names: Iterable[str]) -> "Uncertainty":
        """The same of some of the parameters."""
        kept = tuple(names)
        places = [self.names.index(name) for name in kept]
        rows = tuple(map(tuple, self.array[np.ix_(places, places)].tolist()))
        units = tuple(self.units[place] for place in places) if self.units else ()
        common = {
            name: tuple(changes[place] for place in places) for name, changes in self.common.items()
        }
        return replace(self, names=kept, matrix=rows, units=units, common=common)

    @property
    def random(self) -> "Uncertainty":
        """The part of it that differs from shot to shot, by which coverage is judged."""
        return replace(self, common={})

    def std(self) -> dict[str, float]:
        """Standard uncertainty (1 σ) by name, mm and deg, of the random part."""
        return dict(zip(self.names, np.sqrt(np.diag(self.array)).tolist(), strict=True))

    def total_std(self) -> dict[str, float]:
        """The same with what all shots have in common."""
        variance = np.diag(self.array)
        for changes in self.common.values():
            variance = variance + np.square(changes)
        return dict(zip(self.names, np.sqrt(variance).tolist(), strict=True))

    std_in_file_units = property(std)

    def interval(self) -> dict[str, float]:
        """Half-width of the 95 % interval by name, mm and deg."""
        factor = coverage_factor(self.dof)
        return {name: factor * each for name, each in self.std().items()}

    def largest(self, unit: Literal["mm", "deg"]) -> float:
        """Largest standard uncertainty in a unit; zero where no parameter has it."""
        own = zip(self.std().values(), self.units, strict=True)
        return max((std for std, of in own if of == unit), default=0.0)

    def of_positions(self, sample: WorkspaceSample) -> Array:
        """Standard uncertainty of positions of a sample of the workspace, (N,), mm."""
        if not self.full_rank:
            return np.full(len(sample.jacobian), np.inf)
        jacobian = sample.jacobian[:, :, [sample.names.index(name) for name in self.names]]
        variance = (self.hold_out_ratio * position_std_mm(jacobian, self.array)) ** 2
        for shift_mm in self.common_of_positions(sample).values():
            variance = variance + np.sum(shift_mm**2, axis=1)
        return np.asarray(np.sqrt(variance))

    def common_of_positions(self, sample: WorkspaceSample) -> dict[str, Array]:
        """Shifts of a sample's positions, (N, 3), mm, by one σ of what all shots have in common."""
        jacobian = sample.jacobian[:, :, [sample.names.index(name) for name in self.names]]
        return {name: jacobian @ np.array(changes) for name, changes in self.common.items()}

    def correlations(self) -> Array:
        """Correlation matrix, (F, F), ones on the diagonal."""
        std = np.sqrt(np.diag(self.array))
        return np.asarray(self.array / np.outer(std, std))

    def strongest(self, count: int, least: float = 0.0) -> tuple[Correlation, ...]:
        """Pairs of parameters of the largest |ρ|, strongest first."""
        first, second = np.triu_indices(len(self.names), k=1)
        values = self.correlations()[first, second]
        order = np.argsort(-np.abs(values), kind="stable")[:count]
        found = (
            Correlation(self.names[first[row]], self.names[second[row]], float(values[row]))
            for row in order.tolist()
        )
        return tuple(each for each in found if abs(each.value) >= least)


@dataclass(frozen=True, slots=True)
class HoldOut:
    """Test of pairs that were never fitted against what σ predict of them."""

    pairs: int
    chi2: float
    p: float
    ratio: float
    """Root mean square of their errors over that of their σ."""

    @classmethod
    def of(
        cls, error_mm: Array, own_mm2: Array, by_x: Array, covariance: Array, dof: int | None
    ) -> "HoldOut":
        """Test of errors (M,) whose variances (M,) and those of unknowns x (F, F) are known.

        By ∂error/∂x, (M, F); the scale of both is known by so many degrees of freedom. Solved in
        the unknowns (Woodbury), of which there are fewer than errors.
        """
        weighted = by_x / own_mm2[:, None]
        told, normal = weighted.T @ error_mm, weighted.T @ by_x
        shared = np.linalg.solve(np.eye(len(told)) + normal @ covariance, told)
        chi2 = float(error_mm @ (error_mm / own_mm2) - told @ covariance @ shared)
        variance_mm2 = own_mm2 + np.einsum("mf,mf->m", by_x @ covariance, by_x)
        ratio = float(np.sqrt(np.mean(error_mm**2 / variance_mm2)))
        count = len(error_mm)
        p = (
            scipy.special.chdtrc(count, chi2)
            if dof is None
            else scipy.special.fdtrc(count, dof, chi2 / count)
        )
        return cls(count, chi2, float(p), ratio)

    @property
    def believable(self) -> bool:
        """Whether chance explains as much."""
        return self.p >= SIGNIFICANCE

    @property
    def applied_ratio(self) -> float:
        """Factor of the standard uncertainty of positions that follows."""
        return 1.0 if self.believable else self.ratio


@dataclass(frozen=True, slots=True)
class TrackerScale:
    """Test of the tracker's scale by known lengths."""

    share: float
    """Share by which it measures lengths too long."""
    std: float
    p: float
    """Chance of a tracker within its data sheet to be as far off."""
    scatter_p: float
    """Chance of good measurements to differ as much from one another."""

    @classmethod
    def of(
        cls, residuals_mm: Array, lengths_mm: Array, covariance_mm2: Array, stated: float
    ) -> "TrackerScale":
        """By residuals (M,) of lengths with a covariance (M, M); `stated`: σ of the data sheet."""
        root = np.linalg.cholesky(covariance_mm2)
        along, left = np.linalg.solve(root, np.column_stack([lengths_mm, residuals_mm])).T
        square = float(along @ along)
        share, std = float(along @ left) / square, square**-0.5
        p = scipy.special.chdtrc(1, share**2 / (std**2 + stated**2))
        freedom = len(lengths_mm) - 1
        scatter = float(np.sum((left - share * along) ** 2))
        return cls(
            share, std, float(p), float(scipy.special.chdtrc(freedom, scatter)) if freedom else 1.0
        )

    @property
    def believable(self) -> bool:
        """Whether chance and the data sheet explain as much."""
        return min(self.p, self.scatter_p) >= SIGNIFICANCE

    def scale_std(self, stated: float) -> float:
        """Standard uncertainty of the scale that is left, which is corrected by nothing.

        Where the lengths agree, by the data sheet and by them together.
        """
        if not self.believable:
            return float(np.hypot(self.share, self.std))
        weight = stated**2 / (stated**2 + self.std**2)
        return float(np.hypot(np.sqrt(1.0 - weight) * stated, weight * self.share))


def predict_points(
    kinematics: Kinematics,
    free: tuple[str, ...],
    joints: Array,
    poses: Array,
    covariance_mm2: Array,
) -> tuple[Array, Observability]:
    """Covariance of all unknowns (P, P) that points will give if they scatter as stated.

    Points have covariances (N, 3, 3) in the base frame's axes. In mm and rad, parameters first;
    infinite when the rank is lost. What is seen is of the parameters alone, the tracker's frame
    having been fitted.
    """
    jacobian = whitened(point_jacobian(kinematics, free, joints, poses), covariance_mm2)
    alone = marginalise_frame(jacobian).reshape(-1, len(free))
    return _predicted(jacobian.reshape(-1, jacobian.shape[-1]), alone)


def predict_distances(
    kinematics: Kinematics,
    free: tuple[str, ...],
    joints: Array,
    poses: Array,
    pairs: Index,
    variance_mm2: Array,
) -> tuple[Array, Observability]:
    """The same of distances of pairs (M, 2) with variances (M,), which need no frame, (F, F)."""
    jacobian = distance_jacobian(kinematics, free, joints, poses, pairs)
    jacobian = jacobian / np.sqrt(variance_mm2)[:, None]
    return _predicted(jacobian, jacobian)


def common_by_points(
    kinematics: Kinematics,
    free: tuple[str, ...],
    joints: Array,
    poses: Array,
    covariance_mm2: Array,
    shifts_mm: Mapping[str, Array],
) -> dict[str, Array]:
    """Changes (F,) of parameters, mm and rad, by shifts (N, 3) of all points."""
    jacobian = whitened(point_jacobian(kinematics, free, joints, poses), covariance_mm2)
    shifts = {
        name: whitened(each[:, :, None], covariance_mm2).ravel() for name, each in shifts_mm.items()
    }
    return _changes(jacobian.reshape(-1, jacobian.shape[-1]), len(free), shifts)


def common_by_distances(
    kinematics: Kinematics,
    free: tuple[str, ...],
    joints: Array,
    poses: Array,
    pairs: Index,
    shifts_mm: Mapping[str, Array],
) -> dict[str, Array]:
    """The same by distances of pairs (M, 2) of the points (N, 3), which count alike."""
    first, second = pairs.T
    towards = directions(poses[:, :3], first, second)
    shifts = {
        name: np.einsum("mi,mi->m", towards, each[second] - each[first])
        for name, each in shifts_mm.items()
    }
    return _changes(distance_jacobian(kinematics, free, joints, poses, pairs), len(free), shifts)


def _changes(jacobian: Array, parameters: int, shifts: Mapping[str, Array]) -> dict[str, Array]:
    """Changes of the first unknowns by shifts (M,) of what a Jacobian (M, P) is of."""
    changes = np.linalg.lstsq(jacobian, np.stack([*shifts.values()], axis=1), rcond=None)[0]
    return dict(zip(shifts, changes[:parameters].T, strict=True))


def _predicted(jacobian: Array, alone: Array) -> tuple[Array, Observability]:
    """From a whitened Jacobian (M, P), and that of the parameters alone, (M, F)."""
    try:
        of_all = covariance(jacobian)
    except np.linalg.LinAlgError:
        of_all = np.full((jacobian.shape[1],) * 2, np.inf)
    return of_all, observability(alone)


def _places(kinematics: Kinematics, free: tuple[str, ...]) -> Index:
    return kinematics.mechanism.parameters.places(free)
