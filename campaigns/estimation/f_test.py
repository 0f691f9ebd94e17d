"""F test of further columns beside a fit, in the linearised and whitened shots."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy

from campaigns.arrays import Array
from campaigns.estimation.observability import column_norms, orthonormal_basis

LOST = 1e-4
"""A column of which less than this part is left beside the fit is one of the fit's own."""
UNDERFLOW = 1e-290


def log_p(columns: int, freedom: float, gain: Array | float, chi2: float) -> Array:
    """Logarithm of the chance that columns gain so much of χ² of so many degrees of freedom.

    The fit's degrees of freedom, the columns' included. Logarithms, for p < 1e-308 has no double.
    """
    left = np.clip(1.0 - np.asarray(gain) / chi2, 1e-300, 1.0)
    a, b = 0.5 * (freedom - columns), 0.5 * columns
    p = scipy.special.betainc(a, b, left)
    rest = (b - 1.0) * np.log1p(-np.minimum(left, 0.5))
    first = (
        a * np.log(left) + rest - np.log(a) - scipy.special.betaln(a, b)
    )  # of a series in what is left
    return np.asarray(np.where(p > UNDERFLOW, np.log(np.maximum(p, UNDERFLOW)), first))


@dataclass(frozen=True, eq=False)
class FittedShots:
    """Whitened residuals of N shots after a linear fit, and the columns that it took up."""

    left: Array
    """(3 N,)"""
    basis: Array
    """Orthonormal, (3 N, R)."""
    _beside: dict[int, tuple[Array, Array]] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(cls, residual: Array, jacobian: Array) -> "FittedShots":
        """Shots (N, 3) fitted by a Jacobian (N, 3, P)."""
        flat = residual.ravel()
        basis = orthonormal_basis(jacobian.reshape(len(flat), -1))
        return cls(flat - basis @ (basis.T @ flat), basis)

    @cached_property
    def basis_from_last(self) -> Array:
        """The basis of each shot, the last one first, (N, 3, R)."""
        return np.ascontiguousarray(self.basis.reshape(-1, 3, self.basis.shape[1])[::-1])

    @property
    def chi2(self) -> float:
        """Sum of squares that is left."""
        return float(self.left @ self.left)

    @property
    def freedom(self) -> int:
        """Degrees of freedom that are left."""
        return int(self.left.size - self.basis.shape[1])

    def beside(self, columns: Array) -> Array:
        """What is left of columns (N, 3, k) beside the fit, (3 N, k); nothing of the fit's own.

        The same columns are asked for more than once.
        """
        return self.beside_each([columns])[0]

    def beside_each(self, several: Sequence[Array]) -> list[Array]:
        """The same of each of several, in less time than of one after the other."""
        unknown = [each for each in several if id(each) not in self._beside]
        if unknown:
            flat = np.concatenate(unknown, axis=2).reshape(self.left.size, -1)
            left = flat - self.basis @ (self.basis.T @ flat)
            left[:, column_norms(left) <= LOST * column_norms(flat)] = 0.0
            ends = np.cumsum([each.shape[2] for each in unknown])
            for each, own in zip(unknown, np.split(left, ends[:-1], axis=1), strict=True):
                self._beside[id(each)] = each, own
        return [self._beside[id(each)][1] for each in several]

    def fitted(self, columns: Array) -> "FittedShots":
        """The same with further columns (N, 3, k) in the fit."""
        more = orthonormal_basis(self.beside(columns))
        return FittedShots(
            self.left - more @ (more.T @ self.left), np.concatenate([self.basis, more], axis=1)
        )
