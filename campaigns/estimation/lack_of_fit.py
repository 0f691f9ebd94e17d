"""Lack of fit: what a model leaves that is a function of the joints, and no scatter.

Scatter of a robot is new at every shot. What a model lacks (rods of unequal length, tilted axes,
bending) is the same at the same joints and changes slowly with them: F tests of low polynomials of
the joints, and of what imperfect parts would make, beside all unknowns of the fit, tell them apart.
"""

from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Literal, get_args

import numpy as np
from scipy.special import fdtrc

from campaigns.arrays import Array
from campaigns.estimation.information import EXACT, SIGNIFICANCE
from campaigns.estimation.observability import orthonormal_basis

Kind = Literal["joints", "parts"]
"""Polynomials of the joints, or unequal rods and tilted axes."""
DEGREE = 2
LEAST_FREEDOM = 30
"""Degrees of freedom that must be left beside the polynomials."""


@dataclass(frozen=True, slots=True)
class LackOfFit:
    """Test of what a model leaves of the shots, by columns of one kind."""

    kind: Kind
    share: float
    """Part of the residuals' variance that the columns explain beyond chance."""
    p: float

    @property
    def significant(self) -> bool:
        """Significance: it is more than chance makes, of as many tests as there are kinds."""
        return self.p < SIGNIFICANCE / len(get_args(Kind))


def smooth_columns(joints: Array) -> Array:
    """Displacements of points (N, 3, m) that are polynomials of the joints (N, n)."""
    spread = joints.std(axis=0)
    scaled = (joints - joints.mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)
    places = range(joints.shape[1])
    terms = [
        np.prod(scaled[:, list(chosen)], axis=1)
        for degree in range(1, DEGREE + 1)
        for chosen in combinations_with_replacement(places, degree)
    ]
    columns = np.einsum("nt,kl->nktl", np.stack(terms, axis=1), np.eye(3))
    return np.asarray(columns.reshape(len(joints), 3, -1))


def enough_shots(shots: int, unknowns: int, columns: int) -> bool:
    """Sufficiency of so many shots to tell anything beside unknowns and columns."""
    return 3 * shots - unknowns - columns >= LEAST_FREEDOM


def lack_of_fit(residual: Array, jacobian: Array, columns: Array, kind: Kind) -> LackOfFit | None:
    """Test of columns (N, 3, m) beside (N, 3) and (N, 3, P), all whitened; None for few shots."""
    count, unknowns = len(residual), jacobian.shape[-1]
    if not enough_shots(count, unknowns, columns.shape[-1]):
        return None
    explained = orthonormal_basis(jacobian.reshape(3 * count, -1))
    left = residual.ravel() - explained @ (explained.T @ residual.ravel())
    rows = columns.reshape(3 * count, -1)
    more = orthonormal_basis(rows - explained @ (explained.T @ rows))
    gain, chi2 = float(np.sum((more.T @ left) ** 2)), float(left @ left)
    m, freedom = more.shape[1], 3 * count - explained.shape[1] - more.shape[1]
    if m == 0 or chi2 <= gain or chi2 <= EXACT**2 * 3 * count:
        return None
    rest = (chi2 - gain) / freedom
    share = max(0.0, gain - m * rest) / chi2
    return LackOfFit(kind, share, float(fdtrc(m, freedom, gain / m / rest)))
