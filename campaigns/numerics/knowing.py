"""What shots tell of the parameters so far, their own scatter taken into account.

As `identify` will: coordinates are believed to scatter as their tracker states until a test of χ²
says otherwise, and then their scatter multiplies every σ; for distances it always does. It never
makes any smaller.
"""

from dataclasses import dataclass

import numpy as np

from campaigns.numerics.candidates import FRAME_COLUMNS
from campaigns.numerics.estimate import noise_of
from campaigns.numerics.geometry import Array, Index
from campaigns.numerics.instrument import common_variance_mm2, distance_variance_mm2
from campaigns.numerics.pairs import directions, distances_mm
from campaigns.numerics.par4 import NoAssembly
from campaigns.numerics.problem import Problem
from campaigns.numerics.robust import Loss, agreement, fit_of_agreed
from campaigns.numerics.running import Linearised
from campaigns.numerics.statistics import covariance

LEAST_DOF = 12
"""Degrees of freedom below which the scatter, known to ± 20 % by so many, is not relied on."""


@dataclass(frozen=True, slots=True, eq=False)
class Told:
    """What shots tell of F parameters."""

    covariance: Array
    """Of the parameters, (F, F), mm and rad."""
    scatter: float
    """√(χ²/dof): what the best fit leaves over what is stated."""
    scale: float
    """What this multiplied every standard deviation by."""


def told_by_points(
    seen: Linearised, covariance_mm2: Array, *, foreseen: bool = False
) -> Told | None:
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
    return _told(rows, misfit, parameters, trusted=True, foreseen=foreseen)


def told_by_distances(
    seen: Linearised, covariance_mm2: Array, pairs: Index, *, foreseen: bool = False
) -> Told | None:
    """What distances of pairs (M, 2) tell, all taken as equally sure, as the paper does.

    None while that is not yet known.
    """
    first, second = pairs.T
    variance = distance_variance_mm2(seen.points_mm, covariance_mm2, first, second)
    if len(pairs) == 0 or not np.all(variance > 0.0):
        return None
    std_mm = np.sqrt(common_variance_mm2(variance))
    towards = directions(seen.points_mm, first, second)
    apart = (seen.rows[second] - seen.rows[first])[:, :, :-FRAME_COLUMNS]
    rows = np.einsum("mk,mkf->mf", towards, apart) / std_mm
    measured = distances_mm(seen.points_mm - seen.misfit_mm, first, second)
    misfit = (distances_mm(seen.points_mm, first, second) - measured) / std_mm
    return _told(rows, misfit, rows.shape[1], trusted=False, foreseen=foreseen)


def told_by_fit(problem: Problem, parameters: int, *, trusted: bool) -> Told | None:
    """What a fit to the end tells of the first of its unknowns, outliers left out of it.

    `trusted`: whether what is stated holds until a test of χ² says otherwise. None while it is not
    yet known, or the solver finds no answer. Takes some twenty times as long as the others.
    """
    try:
        agreed = agreement(problem)
        fit = fit_of_agreed(problem, Loss(), agreed).fit
    except (NoAssembly, np.linalg.LinAlgError):
        return None
    rows = np.repeat(agreed.kept, problem.block)
    if not fit.converged:
        return None
    return _told(fit.jacobian[rows], fit.residual[rows], parameters, trusted=trusted)


def _told(
    rows: Array, misfit: Array, parameters: int, *, trusted: bool, foreseen: bool = False
) -> Told | None:
    """From whitened rows (M, P) and misfit (M,), the first of the P unknowns being parameters."""
    dof = len(rows) - rows.shape[1]
    if dof < (0 if foreseen else LEAST_DOF):
        return None
    # the misfit as a last column: what of it no change of the unknowns explains ends in the corner
    triangle = np.asarray(np.linalg.qr(np.column_stack([rows, misfit]), mode="r"))
    try:
        of_all = covariance(triangle[:-1, :-1])
    except np.linalg.LinAlgError:
        return None
    if foreseen:
        return Told(of_all[:parameters, :parameters], 0.0, 1.0)
    noise = noise_of(float(triangle[-1, -1] ** 2), dof, None)
    scatter = float(np.sqrt(noise.chi2 / dof))
    scale = 1.0 if trusted and noise.believable else max(1.0, scatter)
    return Told(scale**2 * of_all[:parameters, :parameters], scatter, scale)
