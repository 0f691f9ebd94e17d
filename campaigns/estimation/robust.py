"""Robust estimation: M-estimators, and rejection of blocks that all others contradict.

Losses and outliers are judged by whole blocks, never by single coordinates, and priors take no part
in it: they are neither weighed down nor left out.
"""

from dataclasses import dataclass, replace
from itertools import combinations
from math import comb
from typing import TypeAlias

import numpy as np
import scipy

from campaigns.arrays import Array, Mask
from campaigns.estimation.estimators import LossShape
from campaigns.estimation.gauss_newton import SETTLED
from campaigns.estimation.least_squares import LeastSquaresProblem, Solution, block_norms, solve

REWEIGHTINGS = 30
WEIGHTS_SETTLED, WEIGHTS_UNSETTLED = 1e-6, 0.02
UNSETTLED = "not converged: the loss's weights change without end; a larger --loss-scale may help"
REJECTION_ROUNDS = 10
FALSE_ALARM = 0.01
"""Chance that a whole set of good blocks loses one of them."""
ROUNDING = 1e-12
"""Whitened residuals below this are none."""
TUNING_CONSTANT = 3.0
"""Size in σ from which the price of a misfit stops growing with its square, unless told."""


@dataclass(frozen=True, slots=True)
class Loss:
    """Price of a block's misfit: how it grows, and where it begins to differ from the square."""

    shape: LossShape = LossShape.LINEAR
    scale: float = TUNING_CONSTANT
    """In standard deviations, as the blocks' median shows them."""


SNOOPED = 3
"""Measurements that are left out together at most."""
FEW_FREEDOM = 40
LEAST_FREEDOM = 2
"""Degrees of freedom that tell a scatter once wrong ones are left out."""
UNBELIEVABLE = 1e-3
"""Chance of χ² below which some are wrong, or all scatter more than stated."""
LARGEST = 1e3
"""σ: beyond it no error of a measurement and no scatter is looked for."""
LEAST_LEFT = 1e-8
"""Of a block's variance, when the fit follows it wherever it goes."""
LINEAR_WITHIN = 1e-4
"""Part of a size by which a problem made linear may have it wrong, for each σ of the largest size:
ten times what the misfits of a mechanism's shots show."""
LINEAR_TO = 100.0
"""Largest size, in σ, that is judged so: of random wrong shots the first mistake was at 170."""
LINEAR_OUTLIERS = 3
"""Most blocks that may go so: of encoders that slipped, the first mistake was at nine."""
MOST_FITTED_AWAY = 0.9
"""Share of the residuals' variance that the unknowns can take up."""
INITIAL_M_ESTIMATOR = Loss(LossShape.CAUCHY)
"""Finds where most blocks agree, however far away the others are."""
NEARLY_SOLVED = 1e-2
"""`settled_at` of its fits, each of which begins where the last one ended: they settle with the
weights."""


@dataclass(frozen=True, slots=True, eq=False)
class RobustFit:
    """A fit, in the problem's subspace if there is one, and the weight that each block had."""

    fit: Solution
    weights: Array
    """(blocks,), zero for what was left out."""
    scale: float
    """Standard deviation of the whitened residuals by the median of the blocks."""


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


def loss_weights(shape: LossShape, square: Array) -> Array:
    """ρ'(z) of each block for z = (size / scale)²: what reweighted least squares gives it."""
    if shape is LossShape.SOFT_L1:
        return np.asarray(1.0 / np.sqrt(1.0 + square))
    if shape is LossShape.CAUCHY:
        return np.asarray(1.0 / (1.0 + square))
    return np.ones_like(square)


def loss_curvature(shape: LossShape, square: Array, block: int) -> Array:
    """Mean second derivative of ½ρ by a block's coordinates: ρ' + 2 z ρ'' / k, for k of them."""
    weights = loss_weights(shape, square)
    if shape is LossShape.SOFT_L1:
        return np.asarray(weights - square * weights**3 / block)
    if shape is LossShape.CAUCHY:
        return np.asarray(weights - 2.0 * square * weights**2 / block)
    return weights


def solve_robust(
    problem: LeastSquaresProblem,
    loss: Loss,
    kept: Mask,
    start: Array | None = None,
    spent: int = 0,
    settled_at: float = SETTLED,
) -> RobustFit:
    """Least squares of the kept blocks, reweighted until the weights stand.

    A fit whose weights do not come to stand has not converged. `settled_at`: of each, as `solve`.
    """
    weights, change = kept.astype(np.float64), 0.0
    for _ in range(REWEIGHTINGS):
        weighted = problem.weighted(weights)
        fit = solve(weighted, start=start, spent=spent, settled_at=settled_at)
        sizes = problem.sizes(fit.x)
        scale = robust_scale(sizes[kept], problem.block, _followed(problem, fit))
        if loss.shape is LossShape.LINEAR:
            break
        threshold = max(loss.scale * scale, ROUNDING)
        renewed = kept * loss_weights(loss.shape, (sizes / threshold) ** 2)
        change = float(np.abs(renewed - weights).max())
        weights, start, spent = renewed, fit.x, fit.evaluations
        if change < WEIGHTS_SETTLED:
            break
    if change > WEIGHTS_UNSETTLED:
        fit = replace(fit, converged=False, message=UNSETTLED)
    return RobustFit(fit, weights, scale)


def _followed(problem: LeastSquaresProblem, fit: Solution) -> int:
    """Number of measurements that a fit can go through: what priors tell needs none."""
    return max(len(fit.x) - len(problem.priors), 0)


def fit_inliers(
    problem: LeastSquaresProblem,
    loss: Loss,
    agreed: Inliers,
    start: Array | None = None,
    spent: int = 0,
) -> RobustFit:
    """Of what agrees, by any loss; plain least squares need not be found twice."""
    if loss.shape is not LossShape.LINEAR or agreed.fit is None:
        return solve_robust(problem, loss, agreed.kept, start, spent)
    sizes = problem.sizes(agreed.fit.x)[agreed.kept]
    scale = robust_scale(sizes, problem.block, _followed(problem, agreed.fit))
    return RobustFit(agreed.fit, agreed.kept.astype(np.float64), scale)


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
    snooped = _snooped(problem, plain)
    if snooped is not None:
        return snooped
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


def linear_inliers(jacobian: Array, residual: Array, block: int) -> Mask | None:
    """Blocks that agree, (blocks,), as `reject_outliers` tells them, by a problem made linear.

    Of the whitened residual (M,) and Jacobian (M, P) of its plain fit. None where the problem
    itself might tell otherwise: a size is close to a limit or too large, or many would have to go.
    """
    largest = float(block_norms(residual, block).max())
    if largest > LINEAR_TO:
        return None
    rows = jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), ROUNDING)
    loss, weights = INITIAL_M_ESTIMATOR, np.ones(len(residual) // block)

    def sizes_by(weights: Array) -> Array:
        weighted = rows * np.repeat(weights, block)[:, None]
        step = np.linalg.solve(weighted.T @ rows, weighted.T @ residual)
        return block_norms(residual - rows @ step, block)

    for _ in range(REWEIGHTINGS):
        sizes = sizes_by(weights)
        scale = robust_scale(sizes, block, rows.shape[1])
        square = (sizes / max(loss.scale * scale, ROUNDING)) ** 2
        old, weights = weights, loss_weights(loss.shape, square)
        if np.abs(weights - old).max() < WEIGHTS_SETTLED:
            break
    limit = max(1.0, scale) * rejection_threshold(len(weights), block)
    within = LINEAR_WITHIN * largest
    kept, last = sizes <= limit, None
    back = np.zeros_like(kept)
    for _ in range(REJECTION_ROUNDS):
        if (np.abs(sizes / limit - 1.0) < within).any() or (~kept).sum() > LINEAR_OUTLIERS:
            return None
        if last is not None and np.array_equal(kept, last):
            break
        sizes, limit = _studentized_sizes(sizes_by(kept.astype(np.float64)), rows, kept, block)
        back |= ~kept & (sizes <= limit)
        kept, last = back | (sizes <= limit), kept
    return kept


def _snooped(problem: LeastSquaresProblem, plain: Solution) -> Inliers | None:
    """Single measurements that are wrong, told from all scattering more than stated.

    Data snooping (Baarda 1968) for blocks of one number with few degrees of freedom, where a robust
    fit bends to the wrong ones: none or the best subset of one, two or three, whichever has the
    largest marginal likelihood. None where χ² is believable, or where there is too much freedom.
    """
    freedom = problem.blocks - len(plain.x)
    most = min(SNOOPED, freedom - LEAST_FREEDOM)
    if problem.block != 1 or len(problem.priors) or most < 0 or freedom > FEW_FREEDOM:
        return None
    residual, jacobian = problem.residual(plain.x), problem.jacobian(plain.x)
    if float(scipy.special.chdtrc(freedom, residual @ residual)) >= UNBELIEVABLE:
        return None
    basis, _ = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), ROUNDING))
    left = np.eye(problem.blocks) - basis @ basis.T
    best, likeliest = Inliers(np.ones(problem.blocks, dtype=bool), (), plain), -np.inf
    for count in range(most + 1):
        wrong = _best_subset(left, left @ residual, count) if count else []
        kept = np.ones(problem.blocks, dtype=bool)
        kept[wrong] = False
        fit = solve(problem.weighted(kept.astype(np.float64)), start=plain.x, spent=0)
        chi2 = float(np.sum(problem.sizes(fit.x)[kept] ** 2))
        likelihood = _log_marginal_likelihood(chi2, freedom - count, count, problem.blocks)
        if likelihood > likeliest:
            sizes, limit = _studentized(problem, fit, kept)
            outliers = tuple((row, float(sizes[row]), limit) for row in wrong)
            best, likeliest = Inliers(kept, outliers, fit), likelihood
    return best


def _log_marginal_likelihood(chi2: float, freedom: int, wrong: int, blocks: int) -> float:
    """Logarithm of the marginal likelihood of what is left of so many blocks without the wrong.

    With the stated σ or, where that says more, with one of their own, whose logarithm is as likely
    anywhere from the stated to the largest; each wrong block may be any, off by any size to it.
    """
    scatter = max(chi2 / freedom, 1.0)
    width = np.sqrt(np.pi / freedom) / np.log(LARGEST)
    by_scatter = -0.5 * freedom * (np.log(scatter) + chi2 / (freedom * scatter)) + np.log(width)
    price = np.log(comb(blocks, wrong)) + wrong * np.log(2.0 * LARGEST / np.sqrt(2.0 * np.pi))
    return float(max(-0.5 * chi2, by_scatter) - price)


def _best_subset(left: Array, misfit: Array, count: int) -> list[int]:
    """Rows whose deletion takes most off χ²; by all subsets of so many."""
    chosen = np.array(list(combinations(range(len(misfit)), count)), dtype=np.intp)
    own = left[chosen[:, :, None], chosen[:, None, :]] + LEAST_LEFT * np.eye(count)
    told = misfit[chosen]
    gain = np.einsum("ni,ni->n", told, np.linalg.solve(own, told[:, :, None])[:, :, 0])
    return [int(row) for row in chosen[int(np.argmax(gain))]]


def rejection_threshold(blocks: int, block: int, freedom: float = np.inf) -> float:
    """Size in σ that one of so many good blocks exceeds with a chance of 1 % in all.

    `freedom`: how many degrees of freedom that σ was estimated from.
    """
    chance = FALSE_ALARM / blocks
    if np.isinf(freedom):
        return float(np.sqrt(scipy.special.chdtri(block, chance)))
    return float(np.sqrt(block * scipy.special.fdtri(block, freedom, 1.0 - chance)))


def _consensus_set(problem: LeastSquaresProblem, start: Array) -> Mask:
    """The blocks that a robust fit finds near each other."""
    everything = np.ones(problem.blocks, dtype=bool)
    found = solve_robust(problem, INITIAL_M_ESTIMATOR, everything, start, settled_at=NEARLY_SOLVED)
    sizes = problem.sizes(found.fit.x)
    scale = max(1.0, found.scale)
    return np.asarray(sizes <= scale * rejection_threshold(problem.blocks, problem.block))


def _studentized(problem: LeastSquaresProblem, fit: Solution, kept: Mask) -> tuple[Array, float]:
    """Size of each block in its own σ beside a plain fit of the kept ones, and the limit."""
    rows = problem.weighted(np.ones(problem.blocks)).jacobian(fit.x)
    return _studentized_sizes(problem.sizes(fit.x), rows, kept, problem.block)


def _studentized_sizes(sizes: Array, rows: Array, kept: Mask, block: int) -> tuple[Array, float]:
    """The same of sizes (blocks,), with the Jacobian (M + K, P) of blocks and priors."""
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
