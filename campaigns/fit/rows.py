"""Rows of one kind of observation in a fit: residuals, derivatives, noise and weights.

All sums of a fit run over such rows, of points and of all other kinds alike.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from campaigns.arrays import Array, Mask


@dataclass(frozen=True, eq=False)
class Rows:
    """Observations of one kind at some unknowns, with what each counts."""

    residual: Array
    """Predicted less measured, (M, r), mm."""
    jacobian: Array
    """∂residual/∂(unknowns, frames), (M, r, Q)."""
    noise: Mapping[str, Array]
    """Parts V_k of the noise, (M, r, r) by name, before their factors."""
    factors: Mapping[str, float]
    """Factor φ of each part."""
    usable: Mask
    """Observations whose joints assemble, (M,)."""
    good: Array
    """Probability of each to be good, its weight, (M,)."""

    @cached_property
    def total_noise(self) -> Array:
        """Covariance of each observation, (M, r, r)."""
        return np.asarray(sum(self.factors[part] * v for part, v in self.noise.items()))

    @cached_property
    def inverse_noise(self) -> Array:
        """Inverse W of the covariance of each observation, (M, r, r)."""
        return np.asarray(np.linalg.inv(self.total_noise))

    @cached_property
    def weights(self) -> Array:
        """Weights w W, (M, r, r)."""
        return np.asarray(self.good[:, None, None] * self.inverse_noise)

    @cached_property
    def weighted_jacobian(self) -> Array:
        """Derivatives times the weights, w W A, (M, r, Q)."""
        return np.asarray(self.weights @ self.jacobian)

    @property
    def normal(self) -> tuple[Array, Array]:
        """Normal equations: A'WA (Q, Q) and A'Wr (Q,)."""
        rows = self.jacobian.reshape(-1, self.jacobian.shape[2])
        weighted = self.weighted_jacobian.reshape(rows.shape)
        return weighted.T @ rows, weighted.T @ self.residual.ravel()

    @property
    def count(self) -> float:
        """Number of rows, each by its weight."""
        return float(self.residual.shape[1] * self.good.sum())

    @property
    def chi2(self) -> float:
        """χ² of the residuals of observations that count."""
        counted = self.good > 0.0
        residual = self.residual[counted]
        return float(np.einsum("ni,nij,nj->", residual, self.weights[counted], residual))

    def after(self, step: Array) -> Array:
        """Return the residuals (M, r) after a step (Q,), in the linearised model."""
        return np.asarray(self.residual + self.jacobian @ step)

    def by_unknowns(self, covariance: Array) -> Array:
        """Return the covariance A C A' of each prediction, (M, r, r)."""
        return blocks_of(self.jacobian, covariance)


def blocks_of(columns: Array, covariance: Array) -> Array:
    """Return c C c' (M, r, r) of each observation's columns (M, r, Q) and a covariance (Q, Q)."""
    rows = columns.reshape(-1, columns.shape[2]) @ covariance
    return np.asarray(rows.reshape(columns.shape) @ columns.swapaxes(1, 2))
