"""What a plan will tell before anything has moved: standard deviations and observability."""

from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.estimation.estimate import chi_square_test
from campaigns.estimation.incremental_fit import LinearizedModel
from campaigns.estimation.least_squares import LeastSquaresProblem
from campaigns.estimation.observability import (
    covariance,
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
from campaigns.estimation.robust import Loss, fit_inliers, reject_outliers
from campaigns.estimation.tracker_noise import distance_variance_mm2, pooled_variance_mm2
from campaigns.mechanisms.geometry import Geometry, indices
from campaigns.mechanisms.par4 import NoSolution, parameter_jacobian


@dataclass(frozen=True, slots=True, eq=False)
class PredictedCovariance:
    """What a plan tells of the free parameters."""

    std: Array
    """1 σ in mm and rad, (F,)."""
    rank: int
    condition: float
    indices: dict[str, float]
    """O1…O5 (Sun & Hollerbach 2008)."""


def predict_distances(
    geometry: Geometry,
    free: tuple[str, ...],
    joints_rad: Array,
    poses: Array,
    pairs: Index,
    variance_mm2: Array,
) -> PredictedCovariance:
    """What distances of pairs (M, 2) with variances (M,) will tell of the free parameters.

    Lost rank gives infinite standard deviations.
    """
    by_shot = parameter_jacobian(geometry, joints_rad, poses)[:, :3, indices(free)]
    first, second = pairs.T
    direction = directions(poses[:, :3], first, second)
    jacobian = np.einsum("mk,mkf->mf", direction, by_shot[second] - by_shot[first])
    whitened = jacobian / np.sqrt(variance_mm2)[:, None]
    seen = observability(whitened)
    full = seen.rank == len(free)
    std = np.sqrt(np.diag(covariance(whitened))) if full else np.full(len(free), np.inf)
    return PredictedCovariance(
        std, seen.rank, seen.condition, observability_indices(seen.singular_values, len(pairs))
    )


def predict_points(
    geometry: Geometry,
    free: tuple[str, ...],
    joints_rad: Array,
    poses: Array,
    covariance_mm2: Array,
) -> PredictedCovariance:
    """What points with covariances (N, 3, 3), in the base frame's axes, will tell.

    Rank, condition and indices are of the parameters alone, the tracker's frame having been fitted.
    Lost rank gives infinite standard deviations.
    """
    whitened = _whitened(point_jacobian(geometry, free, joints_rad, poses), covariance_mm2)
    jacobian = marginalise_frame(whitened).reshape(-1, len(free))
    seen = observability(jacobian)
    full = seen.rank == len(free)
    std = np.sqrt(np.diag(covariance(jacobian))) if full else np.full(len(free), np.inf)
    indices = observability_indices(seen.singular_values, len(jacobian))
    return PredictedCovariance(std, seen.rank, seen.condition, indices)


def points_covariance(
    geometry: Geometry,
    free: tuple[str, ...],
    joints_rad: Array,
    poses: Array,
    covariance_mm2: Array,
) -> Array:
    """Covariance of the free parameters and the frame, (F + 6, F + 6), mm and rad.

    Raises `LinAlgError` when the rank is lost.
    """
    whitened = _whitened(point_jacobian(geometry, free, joints_rad, poses), covariance_mm2)
    return covariance(whitened.reshape(-1, whitened.shape[-1]))


def position_std_mm(rows: Array, covariance_matrix: Array) -> Array:
    """Root of the summed variances of X, Y and Z where rows (N, 3, P) look, (N,).

    With `point_jacobian` and the covariance of parameters and frame: in the frame that the same
    shots gave. With `marginalise_frame` and the parameters' covariance alone: after a best fit of
    the frame.
    """
    variance = np.einsum("nkp,pq,nkq->n", rows, covariance_matrix, rows, optimize=True)
    return np.asarray(np.sqrt(variance))


def _whitened(rows: Array, covariance_mm2: Array) -> Array:
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance_mm2)) @ rows)


MINIMUM_DOF = 12
"""Degrees of freedom below which the scatter, known to ± 20 % by so many, is not relied on."""


@dataclass(frozen=True, slots=True, eq=False)
class PosteriorCovariance:
    """What shots tell of F parameters."""

    covariance: Array
    """Of the parameters, (F, F), mm and rad."""
    scatter: float
    """√(χ²/dof): what the best fit leaves over what is stated."""
    scale: float
    """What this multiplied every standard deviation by."""


def covariance_from_points(
    seen: LinearizedModel, covariance_mm2: Array, *, foreseen: bool = False
) -> PosteriorCovariance | None:
    """What coordinates of covariances (N, 3, 3), in the points' frame, tell.

    `foreseen`: they are not measured yet, and have no scatter to be judged by. The tracker's frame
    is six more unknowns. None while that is not yet known: for too few shots,
    a lost rank, or a covariance that cannot be.
    """
    try:
        whitening = np.linalg.inv(np.linalg.cholesky(covariance_mm2))
    except np.linalg.LinAlgError:
        return None
    rows = (whitening @ seen.rows).reshape(-1, seen.rows.shape[-1])
    misfit = np.einsum("nij,nj->ni", whitening, seen.misfit_mm).ravel()
    parameters = rows.shape[1] - FRAME_COLUMNS
    return _posterior(rows, misfit, parameters, trusted=True, foreseen=foreseen)


def covariance_from_distances(
    seen: LinearizedModel, covariance_mm2: Array, pairs: Index, *, foreseen: bool = False
) -> PosteriorCovariance | None:
    """What distances of pairs (M, 2) tell, all taken as equally sure, as the paper does.

    None while that is not yet known.
    """
    first, second = pairs.T
    variance = distance_variance_mm2(seen.points_mm, covariance_mm2, first, second)
    if len(pairs) == 0 or not np.all(variance > 0.0):
        return None
    std_mm = np.sqrt(pooled_variance_mm2(variance))
    towards = directions(seen.points_mm, first, second)
    apart = (seen.rows[second] - seen.rows[first])[:, :, :-FRAME_COLUMNS]
    rows = np.einsum("mk,mkf->mf", towards, apart) / std_mm
    measured = distances_mm(seen.points_mm - seen.misfit_mm, first, second)
    misfit = (distances_mm(seen.points_mm, first, second) - measured) / std_mm
    return _posterior(rows, misfit, rows.shape[1], trusted=False, foreseen=foreseen)


def covariance_from_fit(
    problem: LeastSquaresProblem, parameters: int, *, trusted: bool
) -> PosteriorCovariance | None:
    """What a fit to the end tells of the first of its unknowns, outliers left out of it.

    `trusted`: whether what is stated holds until a test of χ² says otherwise. None while it is not
    yet known, or the solver finds no answer. Takes some twenty times as long as the others.
    """
    try:
        agreed = reject_outliers(problem)
        fit = fit_inliers(problem, Loss(), agreed).fit
    except (NoSolution, np.linalg.LinAlgError):
        return None
    rows = np.repeat(agreed.kept, problem.block)
    if not fit.converged:
        return None
    return _posterior(fit.jacobian[rows], fit.residual[rows], parameters, trusted=trusted)


def _posterior(
    rows: Array, misfit: Array, parameters: int, *, trusted: bool, foreseen: bool = False
) -> PosteriorCovariance | None:
    """From whitened rows (M, P) and misfit (M,), the first of the P unknowns being parameters."""
    dof = len(rows) - rows.shape[1]
    if dof < (0 if foreseen else MINIMUM_DOF):
        return None
    # the misfit as a last column: what of it no change of the unknowns explains ends in the corner
    triangle = np.asarray(np.linalg.qr(np.column_stack([rows, misfit]), mode="r"))
    try:
        of_all = covariance(triangle[:-1, :-1])
    except np.linalg.LinAlgError:
        return None
    if foreseen:
        return PosteriorCovariance(of_all[:parameters, :parameters], 0.0, 1.0)
    noise = chi_square_test(float(triangle[-1, -1] ** 2), dof, None)
    scatter = float(np.sqrt(noise.chi2 / dof))
    scale = 1.0 if trusted and noise.believable else max(1.0, scatter)
    return PosteriorCovariance(scale**2 * of_all[:parameters, :parameters], scatter, scale)


def point_jacobian(
    geometry: Geometry, free: tuple[str, ...], joints_rad: Array, poses: Array
) -> Array:
    """∂(point in a frame to be estimated)/∂(free parameters, frame), (N, 3, F + 6), mm and rad."""
    model = PositionModel(geometry, indices(free), joints_rad, poses)
    unturned = Transform(np.eye(3), np.zeros(3))
    points = np.zeros((len(poses), 3))
    problem = PointResiduals(
        model, points, np.broadcast_to(np.eye(3), (len(poses), 3, 3)), unturned
    )
    return problem.jacobian(problem.start()).reshape(len(poses), 3, -1)


def distance_jacobian(
    geometry: Geometry, free: tuple[str, ...], joints_rad: Array, poses: Array, pairs: Index
) -> Array:
    """∂(distance of each pair)/∂(free parameters), (M, F), mm and rad."""
    model = PositionModel(geometry, indices(free), joints_rad, poses)
    problem = DistanceResiduals(model, pairs[:, 0], pairs[:, 1], np.zeros(len(pairs)))
    return problem.jacobian(problem.start())


def marginalise_frame(rows: Array) -> Array:
    """Rows (N, 3, F + 6) of points after the best fit of their frame, (N, 3, F)."""
    jacobian = rows.reshape(-1, rows.shape[-1])
    left = project_out_nuisance(jacobian, jacobian.shape[1] - FRAME_COLUMNS)
    return left.reshape(len(rows), rows.shape[1], -1)
