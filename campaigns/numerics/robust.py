"""Fits that a few wrong shots cannot spoil, and that name the shots they leave out.

A block is what belongs together: the three whitened coordinates of a shot, or one distance. Losses
and outliers are judged by whole blocks, never by single coordinates.
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from campaigns.numerics.fit import Fit, solve
from campaigns.numerics.geometry import Array
from campaigns.numerics.residuals import Residuals

REWEIGHTINGS = 30
WEIGHTS_SETTLED = 1e-6
REJECTION_ROUNDS = 10
FALSE_ALARM = 0.01
"""Chance that a whole set of good blocks loses one of them."""


class Loss(Enum):
    """How the price of a residual grows; the value is the word on the command line."""

    LINEAR = "linear"
    SOFT_L1 = "soft-l1"
    CAUCHY = "cauchy"


@dataclass(frozen=True, slots=True, eq=False)
class Weighted:
    """A least-squares problem with a weight on every block."""

    data: Residuals
    block: int
    weights: Array
    """(blocks,), at least zero."""

    def start(self) -> Array:
        """The data's."""
        return self.data.start()

    def residual(self, x: Array) -> Array:
        """(M,)."""
        return self._root() * self.data.residual(x)

    def jacobian(self, x: Array) -> Array:
        """(M, P)."""
        return self._root()[:, None] * self.data.jacobian(x)

    def _root(self) -> Array:
        return np.repeat(np.sqrt(self.weights), self.block)


@dataclass(frozen=True, slots=True, eq=False)
class RobustFit:
    """A fit with the weight that each block ended with; zero for what was left out."""

    fit: Fit
    weights: Array
    scale: float
    """What a standard deviation of the whitened residuals turned out to be, by their median."""


@dataclass(frozen=True, slots=True)
class Outlier:
    """A block that the others contradict: its size and the largest believable one, in σ."""

    block: int
    size: float
    limit: float


def block_sizes(residual: Array, block: int) -> Array:
    """Length of each block's residual, (blocks,)."""
    return np.asarray(np.linalg.norm(residual.reshape(-1, block), axis=1))


def robust_scale(sizes: Array, block: int) -> float:
    """Standard deviation of one whitened coordinate, from the median of the blocks' sizes."""
    return float(np.median(sizes) / np.sqrt(chdtri(block, 0.5)))


def loss_weights(loss: Loss, sizes: Array, scale: float) -> Array:
    """ρ'(s²/scale²) of each block: what reweighted least squares gives it."""
    square = (sizes / scale) ** 2
    if loss is Loss.SOFT_L1:
        return np.asarray(1.0 / np.sqrt(1.0 + square))
    if loss is Loss.CAUCHY:
        return np.asarray(1.0 / (1.0 + square))
    return np.ones_like(sizes)


def solve_robust(problem: Residuals, block: int, loss: Loss, scale: float) -> RobustFit:
    """Least squares reweighted until the weights stand; `scale` is where the loss bends, in σ."""
    blocks = len(problem.residual(problem.start())) // block
    weights = np.ones(blocks)
    for _ in range(REWEIGHTINGS):
        fit = solve(Weighted(problem, block, weights))
        sizes = block_sizes(problem.residual(fit.x), block)
        unit = robust_scale(sizes, block)
        renewed = loss_weights(loss, sizes, scale * unit)
        settled = np.abs(renewed - weights).max() < WEIGHTS_SETTLED
        weights = renewed
        if settled:
            break
    return RobustFit(fit, weights, unit)


def solve_without_outliers(
    problem: Residuals, block: int, loss: Loss = Loss.CAUCHY, scale: float = 3.0
) -> tuple[RobustFit, tuple[Outlier, ...]]:
    """Least squares of the blocks that agree, and every block that was left out.

    A robust fit shows which blocks stand apart; those are left out, the rest is fitted plainly, and
    whatever then agrees comes back, until nothing changes.
    """
    first = solve_robust(problem, block, loss, scale)
    kept, fit, unit = np.ones(len(first.weights), dtype=bool), first.fit, first.scale
    for _ in range(REJECTION_ROUNDS):
        sizes = block_sizes(problem.residual(fit.x), block)
        limit = unit * largest_believable(len(sizes), block)
        renewed = sizes <= limit
        if np.array_equal(renewed, kept) and fit is not first.fit:
            break
        kept = renewed
        fit = solve(Weighted(problem, block, kept.astype(np.float64)))
        unit = _scale_of_kept(problem, fit, kept, block)
    named = tuple(
        Outlier(row, float(sizes[row] / unit), float(limit / unit))
        for row in np.flatnonzero(~kept).tolist()
    )
    return RobustFit(fit, kept.astype(np.float64), unit), named


def largest_believable(blocks: int, block: int) -> float:
    """Size in σ that one of so many good blocks exceeds with a chance of 1 % in all."""
    return float(np.sqrt(chdtri(block, FALSE_ALARM / blocks)))


def _scale_of_kept(problem: Residuals, fit: Fit, kept: NDArray[np.bool_], block: int) -> float:
    """Root of the reduced χ² of what was kept; never below what the data state."""
    residual = problem.residual(fit.x).reshape(-1, block)[kept]
    free = max(residual.size - len(fit.x), 1)
    return max(1.0, float(np.sqrt(np.sum(residual**2) / free)))
