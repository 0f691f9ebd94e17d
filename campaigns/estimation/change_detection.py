"""Change during a campaign: tests of a step, or a drift, at every place in time and of every cause.

For each cause (one joint's offset, one arm's length, the tracker's frame) and each shot k an F test
of a step from k on, in the linearised fit whitened with the whole covariance of every shot. The
chance of the largest over all tests is Bonferroni's; of causes with one column Worsley's (1982)
improvement of it, which takes into account that a step from k on and one from k + 1 on are almost
the same test.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import fdtrc, ndtr, ndtri, owens_t

from campaigns.arrays import Array
from campaigns.estimation.information import EXACT
from campaigns.estimation.observability import orthonormal_basis

SIGNIFICANCE = 3e-3
"""Chance of a false alarm over all tests of a campaign, at most."""
FEWEST_BEYOND = 3
"""Shots before and after a step, so that no single gross error makes one."""

ROUNDING = 1e-12

CauseKind = Literal["joint", "length", "frame", "drift"]


@dataclass(frozen=True, slots=True, eq=False)
class Cause:
    """Thing that may change: its columns ∂point/∂change, (N, 3, m)."""

    kind: CauseKind
    name: str
    columns: Array


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """Change that the shots show, by how much, and between which of them."""

    kind: CauseKind
    name: str
    after: int
    """Place of the last shot before it, in the order of time."""
    size: Array
    """By the cause's columns, (m,); of a drift from the first shot to the last."""
    std: Array
    p: float
    """Chance of good shots to show as much anywhere."""


def detect_change(
    whitened_residual: Array, whitened_jacobian: Array, causes: Sequence[Cause], root: Array
) -> Change | None:
    """Most likely change in shots that stand in the order of time; None where chance will do.

    Residual (N, 3) and Jacobian (N, 3, P) are whitened by the inverse of `root` (N, 3, 3).
    """
    count = len(whitened_residual)
    basis = orthonormal_basis(whitened_jacobian.reshape(3 * count, -1))
    freedom = 3 * count - basis.shape[1]
    left = whitened_residual.ravel() - basis @ (basis.T @ whitened_residual.ravel())
    chi2 = float(left @ left)
    if freedom < 2 * FEWEST_BEYOND or count < 2 * FEWEST_BEYOND or chi2 <= EXACT**2 * freedom:
        return None
    by_shot = basis.reshape(count, 3, -1)
    tests = [
        _Tests.of(cause, np.asarray(np.linalg.solve(root, cause.columns)), left, by_shot)
        for cause in causes
    ]
    p_values = [each.p_values(chi2, freedom) for each in tests]
    best = min(range(len(tests)), key=lambda place: float(p_values[place].min()))
    least = float(p_values[best].min())
    p = sum(each.chance_anywhere(least) for each in tests)
    if p >= SIGNIFICANCE:
        return None
    return tests[best].change(int(np.argmin(p_values[best])), chi2, freedom, min(p, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class _Tests:
    """Tests of one cause at K places: places, steps (K, m), their gains and unit covariances.

    `correlation` (K - 1,) is that of each place's statistic with the next one's, where m is 1.
    """

    cause: Cause
    after: Array
    size: Array
    gain: Array
    covariance: Array
    correlation: Array

    @classmethod
    def of(cls, cause: Cause, columns: Array, left: Array, basis: Array) -> "_Tests":
        """Tests with the whitened columns (N, 3, m) beside those of the fit."""
        count = len(columns)
        by_shot = left.reshape(count, 3)
        if cause.kind == "drift":
            columns = columns * np.linspace(0.0, 1.0, count)[:, None, None]
        own = _from_there_on(np.einsum("nkl,nkm->nlm", columns, columns))
        shared = _from_there_on(np.einsum("nkp,nkm->npm", basis, columns))
        gained = _from_there_on(np.einsum("nkm,nk->nm", columns, by_shot))
        first = np.arange(FEWEST_BEYOND, count - FEWEST_BEYOND + 1)
        first = np.zeros(1, dtype=np.intp) if cause.kind == "drift" else first
        normal = (own - shared.swapaxes(1, 2) @ shared)[first]
        inverse = np.asarray(np.linalg.pinv(normal, rcond=1e-10, hermitian=True))
        size = np.einsum("nij,nj->ni", inverse, gained[first])
        gain = np.maximum(np.einsum("ni,ni->n", gained[first], size), 0.0)
        correlation = np.empty(0)
        if columns.shape[2] == 1:
            together = own[first[1:], 0, 0]  # what both of two neighbours have: the later one's
            together = together - np.sum(shared[first[:-1], :, 0] * shared[first[1:], :, 0], axis=1)
            unit = np.sqrt(np.maximum(inverse[:, 0, 0], 0.0))  # rounding where a fit says it all
            correlation = together * unit[:-1] * unit[1:]
        return cls(cause, np.maximum(first - 1, 0), size, gain, inverse, correlation)

    def p_values(self, chi2: float, freedom: int) -> Array:
        """Chance of good shots at each place, (K,)."""
        m = self.size.shape[1]
        rest = np.maximum(chi2 - self.gain, np.finfo(np.float64).tiny) / (freedom - m)
        return np.asarray(fdtrc(m, freedom - m, self.gain / m / rest))

    def chance_anywhere(self, p: float) -> float:
        """Bound on the chance that good shots show a test of so small a p at any of the places.

        Of neighbours beyond ± u both are counted once: P ≤ Σ P(A_k) - Σ P(A_k and A_k+1), whose
        normal probabilities Owen's T tells.
        """
        if not len(self.correlation):
            return p * len(self.gain)
        u, rho = -float(ndtri(0.5 * p)), np.clip(self.correlation, -1.0 + ROUNDING, 1.0)
        apart = owens_t(u, np.sqrt((1.0 - rho) / (1.0 + rho)))
        return float(2.0 * ndtr(-u) + 4.0 * np.sum(apart))

    def change(self, place: int, chi2: float, freedom: int, p: float) -> Change:
        """Change at one of the places."""
        rest = max(chi2 - float(self.gain[place]), 0.0) / (freedom - self.size.shape[1])
        std = np.sqrt(np.abs(rest * np.diag(self.covariance[place])))
        cause, after = self.cause, int(self.after[place])
        return Change(cause.kind, cause.name, after, -self.size[place], std, p)


def _from_there_on(each: Array) -> Array:
    """Sums of a shot and all that follow it."""
    return np.asarray(np.cumsum(each[::-1], axis=0)[::-1])
