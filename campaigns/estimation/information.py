"""Information: how precisely measurements determine the parameters, the one place that says it.

Jacobian of what is measured → whitened → frame marginalised → covariance, times the variance
factor. Plans, runs, identification and studies take every σ from here.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtr, chdtrc, ndtri, stdtrit

from campaigns.arrays import Array, Index
from campaigns.estimation.observability import (
    observability,
    observability_indices,
    project_out_nuisance,
)
from campaigns.estimation.point_sets import directions, distances_mm
from campaigns.estimation.residuals import (
    FRAME_COLUMNS,
    DistanceResiduals,
    PointResiduals,
    PositionModel,
)
from campaigns.estimation.rigid_transforms import Transform
from campaigns.estimation.tracker_noise import distance_variance_mm2, pooled_variance_mm2
from campaigns.mechanisms.mechanism import Kinematics

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
    def birge_ratio(self) -> float | None:
        """√(χ²/ν): scatter over stated scatter; None without degrees of freedom."""
        return float(np.sqrt(self.chi2 / self.dof)) if self.dof > 0 else None


def chi_square_test(chi2: float, dof: int, sigma0: float | None = None) -> ChiSquareTest:
    """Test with the two-sided probability of such a χ²."""
    if dof < 1:
        return ChiSquareTest(chi2, dof, None, sigma0)
    p = 2.0 * min(float(chdtr(dof, chi2)), float(chdtrc(dof, chi2)))
    return ChiSquareTest(chi2, dof, min(p, 1.0), sigma0)


def variance_scale(
    scatter: float | None, tested: ChiSquareTest, *, known_variance: bool, robust: bool = False
) -> float | None:
    """Scale of every σ, the one policy for the variance factor; None where nothing tells it.

    `scatter` is that of the whitened residuals. Where the stated variance counts as known, σ come
    from it until a test of χ² rejects it (or a robust loss leaves no such test), and then from the
    scatter, but never smaller. Elsewhere σ come from the scatter, with the stated variance as a
    prior of `STATED_DOF` degrees of freedom (scaled inverse χ²) until the test rejects it.
    """
    if not known_variance:
        if scatter is None or not tested.consistent:
            return scatter
        pooled = (STATED_DOF + tested.dof * scatter**2) / (STATED_DOF + tested.dof)
        return float(np.sqrt(pooled))
    if scatter is None or (tested.consistent and not robust):
        return 1.0
    return max(1.0, scatter)


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
    return float(ndtri(tail) if dof is None else stdtrit(dof, tail))


def covariance(jacobian: Array) -> Array:
    """(JᵀJ)⁻¹ by QR, for residuals of unit variance, (P, P).

    Raises `LinAlgError` when the rank is lost.
    """
    count, norms = jacobian.shape[1], np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / np.where(norms > 0.0, norms, 1.0)
    triangle = np.asarray(np.linalg.qr(scaled, mode="r"))
    rank = observability(triangle).rank
    if rank < count:
        raise np.linalg.LinAlgError(f"rank {rank} of {count}: no finite covariance")
    root = np.linalg.inv(triangle) / norms[:, None]
    return np.asarray(root @ root.T)


def correlations(covariance_matrix: Array) -> Array:
    """Correlation matrix (P, P), ones on the diagonal."""
    std = np.sqrt(np.diag(covariance_matrix))
    return np.asarray(covariance_matrix / np.outer(std, std))


def largest_std(std: Array, names: Sequence[str]) -> tuple[float, float]:
    """Largest standard deviations of a length and of an angle; zero where there are none."""
    angle = np.array([name.endswith("_deg") for name in names], dtype=bool)
    return float(std[~angle].max(initial=0.0)), float(std[angle].max(initial=0.0))


def point_jacobian(
    kinematics: Kinematics, free: tuple[str, ...], joints: Array, poses: Array
) -> Array:
    """∂(point in a frame to be estimated)/∂(free parameters, frame), (N, 3, F + 6), mm and rad."""
    model = PositionModel(kinematics, _places(kinematics, free), joints, poses)
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
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance_mm2)) @ jacobian)


def marginalise_frame(jacobian: Array) -> Array:
    """Jacobian (N, 3, F + 6) of points after the best fit of their frame, (N, 3, F)."""
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    left = project_out_nuisance(flat, flat.shape[1] - FRAME_COLUMNS)
    return left.reshape(len(jacobian), jacobian.shape[1], -1)


def workspace_jacobian(kinematics: Kinematics, free: tuple[str, ...], poses: Array) -> Array:
    """∂position/∂(free parameters) at poses (N, t), after the best fit of the frame, (N, 3, F)."""
    joints = kinematics.inverse(poses).values_or_raise()
    return marginalise_frame(point_jacobian(kinematics, free, joints, poses))


def jacobian_in_frame(
    kinematics: Kinematics, free: tuple[str, ...], poses: Array, reference: Array
) -> Array:
    """∂position/∂(free parameters) at poses (N, t), in the best frame of others (M, t), (N, 3, F).

    At the reference poses themselves it is `workspace_jacobian`.
    """
    count = len(free)

    def at(each: Array) -> Array:
        joints = kinematics.inverse(each).values_or_raise()
        return point_jacobian(kinematics, free, joints, each)

    flat = at(reference).reshape(-1, count + FRAME_COLUMNS)
    moved = np.linalg.lstsq(flat[:, count:], flat[:, :count], rcond=None)[0]
    jacobian = at(poses)
    return np.asarray(jacobian[:, :, :count] - jacobian[:, :, count:] @ moved)


def position_std_mm(jacobian: Array, covariance_matrix: Array) -> Array:
    """Root of the summed variances of X, Y and Z where a Jacobian (N, 3, P) looks, (N,).

    With `point_jacobian` and the covariance of parameters and frame: in the frame that the same
    shots gave. With `workspace_jacobian` and the parameters' covariance alone: after a best fit of
    the frame.
    """
    variance = np.einsum("nkp,pq,nkq->n", jacobian, covariance_matrix, jacobian, optimize=True)
    return np.asarray(np.sqrt(variance))


@dataclass(frozen=True, slots=True, eq=False)
class PredictedCovariance:
    """Covariance that measurements will give of F parameters if they scatter as stated."""

    covariance: Array
    """(F, F), mm and rad; infinite when the rank is lost."""
    with_frame: Array
    """Of all unknowns, the parameters first, (P, P)."""
    rank: int
    """Of the parameters alone."""
    condition: float
    indices: dict[str, float]
    """O1…O5 (Sun & Hollerbach 2008)."""

    @property
    def full_rank(self) -> bool:
        """Full rank: every parameter will be known."""
        return bool(np.isfinite(self.covariance).all())

    @property
    def std(self) -> Array:
        """1 σ in mm and rad, (F,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @classmethod
    def of(cls, jacobian: Array, alone: Array) -> "PredictedCovariance":
        """From a whitened Jacobian (M, P), and that of the parameters alone, (M, F)."""
        count = alone.shape[1]
        seen = observability(alone)
        try:
            of_all = covariance(jacobian)
        except np.linalg.LinAlgError:
            of_all = np.full((jacobian.shape[1],) * 2, np.inf)
        indices = observability_indices(seen.singular_values, len(alone))
        return cls(of_all[:count, :count], of_all, seen.rank, seen.condition, indices)


def predict_points(
    kinematics: Kinematics,
    free: tuple[str, ...],
    joints: Array,
    poses: Array,
    covariance_mm2: Array,
) -> PredictedCovariance:
    """Covariance from points with covariances (N, 3, 3), in the base frame's axes.

    Rank, condition and indices are of the parameters alone, the tracker's frame having been fitted.
    """
    jacobian = whitened(point_jacobian(kinematics, free, joints, poses), covariance_mm2)
    alone = marginalise_frame(jacobian).reshape(-1, len(free))
    return PredictedCovariance.of(jacobian.reshape(-1, jacobian.shape[-1]), alone)


def predict_distances(
    kinematics: Kinematics,
    free: tuple[str, ...],
    joints: Array,
    poses: Array,
    pairs: Index,
    variance_mm2: Array,
) -> PredictedCovariance:
    """Covariance from distances of pairs (M, 2) with variances (M,)."""
    jacobian = distance_jacobian(kinematics, free, joints, poses, pairs)
    jacobian = jacobian / np.sqrt(variance_mm2)[:, None]
    return PredictedCovariance.of(jacobian, jacobian)


@dataclass(frozen=True, slots=True, eq=False)
class LinearizedModel:
    """Points of N shots about some parameters and frame, to first order."""

    free: tuple[str, ...]
    """The parameters' names, F of them."""
    jacobian: Array
    """∂point/∂(free parameters, frame), (N, 3, F + 6), mm and rad."""
    points_mm: Array
    """As modelled, (N, 3)."""
    residual_mm: Array
    """Modelled minus measured, (N, 3)."""
    from_nominal: Array
    """The parameters less their nominal values, (F,)."""

    def taken(self, places: Index) -> "LinearizedModel":
        """Some of the shots."""
        jacobian, points, residual = (
            each[places] for each in (self.jacobian, self.points_mm, self.residual_mm)
        )
        return LinearizedModel(self.free, jacobian, points, residual, self.from_nominal)

    def by(self, free: tuple[str, ...]) -> "LinearizedModel":
        """Some of the parameters free, the others held at their nominal values."""
        if free == self.free:
            return self
        count = len(self.free)
        kept = [self.free.index(name) for name in free]
        held = [place for place in range(count) if place not in kept]
        back_mm = self.jacobian[:, :, held] @ self.from_nominal[held]
        jacobian = self.jacobian[:, :, [*kept, *range(count, count + FRAME_COLUMNS)]]
        points, residual = self.points_mm - back_mm, self.residual_mm - back_mm
        return LinearizedModel(free, jacobian, points, residual, self.from_nominal[kept])


@dataclass(frozen=True, slots=True, eq=False)
class PosteriorCovariance:
    """Covariance of F parameters from measurements, scaled as `variance_scale` has it."""

    covariance: Array
    """(F, F), mm and rad."""
    birge_ratio: float
    """√(χ²/ν): what the best fit leaves over what is stated."""
    sigma0: float
    """What every standard deviation was multiplied by."""


def covariance_from_points(
    model: LinearizedModel, covariance_mm2: Array
) -> PosteriorCovariance | None:
    """Posterior covariance from coordinates of covariances (N, 3, 3), in the points' frame.

    The tracker's frame is six more unknowns. None while the parameters are not yet known: for too
    few shots, a lost rank, or a covariance that cannot be.
    """
    try:
        whitening = np.linalg.inv(np.linalg.cholesky(covariance_mm2))
    except np.linalg.LinAlgError:
        return None
    jacobian = (whitening @ model.jacobian).reshape(-1, model.jacobian.shape[-1])
    residual = np.einsum("nij,nj->ni", whitening, model.residual_mm).ravel()
    return _posterior(jacobian, residual, jacobian.shape[1] - FRAME_COLUMNS, known_variance=True)


def covariance_from_distances(
    model: LinearizedModel, covariance_mm2: Array, pairs: Index
) -> PosteriorCovariance | None:
    """Posterior covariance from distances of pairs (M, 2), all taken as equally sure.

    None while the parameters are not yet known.
    """
    first, second = pairs.T
    variance = distance_variance_mm2(model.points_mm, covariance_mm2, first, second)
    if len(pairs) == 0 or not np.all(variance > 0.0):
        return None
    std_mm = np.sqrt(pooled_variance_mm2(variance))
    towards = directions(model.points_mm, first, second)
    apart = (model.jacobian[second] - model.jacobian[first])[:, :, :-FRAME_COLUMNS]
    jacobian = np.einsum("mk,mkf->mf", towards, apart) / std_mm
    measured = distances_mm(model.points_mm - model.residual_mm, first, second)
    residual = (distances_mm(model.points_mm, first, second) - measured) / std_mm
    return _posterior(jacobian, residual, jacobian.shape[1], known_variance=False)


def _posterior(
    jacobian: Array, residual: Array, parameters: int, *, known_variance: bool
) -> PosteriorCovariance | None:
    """From a whitened Jacobian (M, P) and residual (M,), the first of the P being parameters."""
    dof = len(jacobian) - jacobian.shape[1]
    if dof < MINIMUM_DOF:
        return None
    # as a last column: what of the residual no change of the unknowns explains ends in the corner
    triangle = np.asarray(np.linalg.qr(np.column_stack([jacobian, residual]), mode="r"))
    try:
        of_all = covariance(triangle[:-1, :-1])
    except np.linalg.LinAlgError:
        return None
    tested = chi_square_test(float(triangle[-1, -1] ** 2), dof)
    ratio = float(np.sqrt(tested.chi2 / dof))
    scale = variance_scale(ratio, tested, known_variance=known_variance)
    assert scale is not None, "there is a scatter"
    return PosteriorCovariance(scale**2 * of_all[:parameters, :parameters], ratio, scale)


def _places(kinematics: Kinematics, free: tuple[str, ...]) -> Index:
    return kinematics.mechanism.parameters.places(free)
