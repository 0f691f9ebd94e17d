"""Rejection of outliers: blocks that all others contradict.

Outliers are judged by whole blocks, never by single coordinates, and priors take no part in it:
they are neither weighed down nor left out.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import scipy

from campaigns.arrays import Array, Mask
from campaigns.estimation.least_squares import LeastSquaresProblem, Solution, solve

REWEIGHTINGS = 30
WEIGHTS_SETTLED = 1e-6
REJECTION_ROUNDS = 10
FALSE_ALARM = 0.01
"""Chance that a whole set of good blocks loses one of them."""
ROUNDING = 1e-12
"""Whitened residuals below this are none."""
TUNING_CONSTANT = 3.0
"""Scale of the Cauchy weights by which most blocks that agree are found, in σ."""
LEAST_LEFT = 1e-8
"""Of a block's variance, when the fit follows it wherever it goes."""
MOST_FITTED_AWAY = 0.9
"""Share of the residuals' variance that the unknowns can take up."""
NEARLY_SOLVED = 1e-2
"""`settled_at` of reweighted fits, each of which begins where the last one ended: they settle with
the weights."""


Outlier: TypeAlias = tuple[int, float, float]
"""A block that the others contradict, its size and the largest believable one, in σ."""


@dataclass(frozen=True, slots=True, eq=False)
class Inliers:
    """Blocks that agree with each other, (blocks,), and those that do not."""

    kept: Mask
    outliers: tuple[Outlier, ...]
    fit: Solution | None = None
    """Plain least squares of what agrees; None where nobody needed it."""


def robust_scale(sizes: Array, block: int, unknowns: int) -> float:
    """Standard deviation of one whitened coordinate, from the median of the blocks' sizes.

    A fit can go through as many measurements as it has unknowns, so the median is that of the
    others (Rousseeuw and Leroy 1987, section 3.4), and what the fit took up is given back.
    """
    taken = min(unknowns / (block * len(sizes)), MOST_FITTED_AWAY)
    below = 0.5 * (1.0 + taken)
    size = float(np.quantile(sizes, below))
    return size / float(np.sqrt((1.0 - taken) * scipy.special.chdtri(block, 1.0 - below)))


def reject_outliers(
    problem: LeastSquaresProblem, start: Array | None = None, spent: int = 0
) -> Inliers:
    """Blocks that agree, told from those that the others contradict.

    Nothing within the stated noise is ever an outlier. Beyond it a robust fit shows which blocks
    stand apart; the rest is fitted plainly, and whatever then agrees comes back, until nothing
    changes. What came back stays, or one that is close to the limit would come and go without end.
    Where half of the blocks would have to go, none can be called wrong.
    """
    everything = np.ones(problem.blocks, dtype=bool)
    plain = solve(problem.weighted(everything), start=start, spent=spent)
    if problem.sizes(plain.x).max() <= rejection_threshold(problem.blocks, problem.block):
        return Inliers(everything, (), plain)
    kept, fit = _consensus_set(problem, plain.x), plain
    back = np.zeros_like(kept)
    for _ in range(REJECTION_ROUNDS):
        if not _enough(kept, problem.block, len(plain.x) - len(problem.priors)):
            return Inliers(everything, (), plain)
        agreeing = problem.weighted(kept.astype(np.float64))
        fit = solve(agreeing, start=fit.x, spent=fit.evaluations)
        sizes, limit = _studentized(problem, fit, kept)
        back |= ~kept & (sizes <= limit)
        agree = back | (sizes <= limit)
        if settled := np.array_equal(agree, kept):
            break
        kept = agree
    outliers = ((row, float(sizes[row]), limit) for row in np.flatnonzero(~kept).tolist())
    return Inliers(kept, tuple(outliers), fit if settled else None)


def rejection_threshold(blocks: int, block: int, freedom: float = np.inf) -> float:
    """Size in σ that one of so many good blocks exceeds with a chance of 1 % in all.

    `freedom`: how many degrees of freedom that σ was estimated from.
    """
    chance = FALSE_ALARM / blocks
    if np.isinf(freedom):
        return float(np.sqrt(scipy.special.chdtri(block, chance)))
    return float(np.sqrt(block * scipy.special.fdtri(block, freedom, 1.0 - chance)))


def _consensus_set(problem: LeastSquaresProblem, start: Array) -> Mask:
    """Find the blocks near each other, by fits that are reweighted as for a Cauchy loss."""
    weights, x, spent = np.ones(problem.blocks), start, 0
    followed = max(len(start) - len(problem.priors), 0)
    for _ in range(REWEIGHTINGS):
        weighted = problem.weighted(weights)
        fit = solve(weighted, start=x, spent=spent, settled_at=NEARLY_SOLVED)
        sizes, x, spent = problem.sizes(fit.x), fit.x, fit.evaluations
        scale = robust_scale(sizes, problem.block, followed)
        old = weights
        weights = 1.0 / (1.0 + (sizes / max(TUNING_CONSTANT * scale, ROUNDING)) ** 2)
        if np.abs(weights - old).max() < WEIGHTS_SETTLED:
            break
    limit = max(1.0, scale) * rejection_threshold(problem.blocks, problem.block)
    return np.asarray(sizes <= limit)


def _studentized(problem: LeastSquaresProblem, fit: Solution, kept: Mask) -> tuple[Array, float]:
    """Size of each block in its own σ beside a plain fit of the kept ones, and the limit."""
    rows = problem.weighted(np.ones(problem.blocks)).jacobian(fit.x)
    sizes, block = problem.sizes(fit.x), problem.block
    measured = block * len(sizes)
    freedom = max(block * int(kept.sum()) + len(rows) - measured - rows.shape[1], 1)
    sigma0 = max(1.0, float(np.sqrt(np.sum(sizes[kept] ** 2) / freedom)))
    leverage = _leverages(rows, kept, block)
    own = np.sqrt(np.where(kept, np.maximum(1.0 - leverage, LEAST_LEFT), 1.0 + leverage))
    return sizes / (sigma0 * own), rejection_threshold(len(sizes), block, freedom)


def _leverages(rows: Array, kept: Mask, block: int) -> Array:
    """Variance of the fit at each block in units of the block's own, (blocks,)."""
    rows = rows / np.maximum(np.linalg.norm(rows, axis=0), ROUNDING)
    measured = block * len(kept)
    counts = np.append(np.repeat(kept, block), np.ones(len(rows) - measured, dtype=bool))
    # the small rows stand for what only blocks that were left out could tell
    triangle = np.linalg.qr(np.vstack([rows[counts], LEAST_LEFT * np.eye(rows.shape[1])]), mode="r")
    spread = rows[:measured] @ np.linalg.inv(triangle)
    return np.asarray(np.sum(spread.reshape(len(kept), -1) ** 2, axis=1) / block)


def _enough(kept: Mask, block: int, unknowns: int) -> bool:
    """Sufficiency of what is kept: it is the greater part, and can still be fitted."""
    return bool(2 * kept.sum() > len(kept) and block * int(kept.sum()) > unknowns)
