"""What the coordinates of shots will tell: parameters, and positions anywhere in the workspace."""

import numpy as np

from campaigns.numerics.candidates import point_rows, without_frame
from campaigns.numerics.geometry import Array, Geometry
from campaigns.numerics.prediction import Prediction, observability_indices
from campaigns.numerics.statistics import covariance, observability


def predict_points(
    geometry: Geometry,
    free: tuple[str, ...],
    joints_rad: Array,
    poses: Array,
    covariance_mm2: Array,
) -> Prediction:
    """What points with covariances (N, 3, 3), in the base frame's axes, will tell.

    Rank, condition and indices are of the parameters alone, the tracker's frame having been fitted.
    Lost rank gives infinite standard deviations.
    """
    whitened = _whitened(point_rows(geometry, free, joints_rad, poses), covariance_mm2)
    jacobian = without_frame(whitened).reshape(-1, len(free))
    seen = observability(jacobian)
    full = seen.rank == len(free)
    std = np.sqrt(np.diag(covariance(jacobian))) if full else np.full(len(free), np.inf)
    indices = observability_indices(seen.singular_values, len(jacobian))
    return Prediction(std, seen.rank, seen.condition, indices)


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
    whitened = _whitened(point_rows(geometry, free, joints_rad, poses), covariance_mm2)
    return covariance(whitened.reshape(-1, whitened.shape[-1]))


def position_std_mm(rows: Array, covariance_matrix: Array) -> Array:
    """Root of the summed variances of X, Y and Z where rows (N, 3, P) look, (N,).

    With `point_rows` and the covariance of parameters and frame: in the frame that the same shots
    gave. With `without_frame` and the parameters' covariance alone: after a best fit of the frame.
    """
    variance = np.einsum("nkp,pq,nkq->n", rows, covariance_matrix, rows, optimize=True)
    return np.asarray(np.sqrt(variance))


def _whitened(rows: Array, covariance_mm2: Array) -> Array:
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance_mm2)) @ rows)
