"""From a problem to an estimate: values, what they are worth, and what had to be left out."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.special import chdtr, chdtrc

from campaigns.arrays import Array, Mask
from campaigns.estimation.estimators import LossShape
from campaigns.estimation.least_squares import IdentifiableSubspace, LeastSquaresProblem, Solution
from campaigns.estimation.observability import (
    Observability,
    covariance,
    observability,
    project_out_nuisance,
)
from campaigns.estimation.robust import (
    ROUNDING,
    Inliers,
    Loss,
    Outlier,
    RobustFit,
    fit_inliers,
    loss_curvature,
    reject_outliers,
    solve_robust,
)

SIGNIFICANCE = 1e-3
"""A χ² that good noise exceeds or falls below less often than this is not believed."""
CONSTRAINT_ROUNDS = 3
VARIANCE_ROUNDS = 6
VARIANCE_SETTLED = 0.01
CONFLICT_SIGMAS = 4.0
"""Standard deviations by which measurements and a prior may differ."""
LEAST_CURVATURE = 0.1
"""Mean curvature of a loss below which most blocks are past its bend: nothing tells the scatter."""
LEAST_FREEDOM = 0.5
"""With less left of the measurements than this their scatter says nothing."""
LEAST_VARIANCE_FACTOR = 1e-3
"""Priors never weigh against less scatter than this part of the stated one."""
NOTHING_MOVES = 1e-6
"""A parameter with less than this share in an unobservable combination takes no part in it."""


@dataclass(frozen=True, slots=True)
class OutlierPolicy:
    """What is done with measurements that do not fit."""

    loss: Loss = field(default_factory=Loss)
    exclude: bool = True
    """Leave out what all others contradict."""


@dataclass(frozen=True, slots=True)
class ChiSquareTest:
    """Whether the measurements scatter as stated (a test of χ²), and what σ are multiplied by."""

    chi2: float
    dof: int
    p: float | None
    """Chance of good noise to lie as far out, on either side; None without degrees of freedom."""
    scale: float | None
    """None where nothing tells the scatter."""

    @property
    def believable(self) -> bool | None:
        """None: there is nothing to tell by."""
        return None if self.p is None else self.p >= SIGNIFICANCE

    @property
    def ratio(self) -> float | None:
        """Scatter over stated scatter."""
        return float(np.sqrt(self.chi2 / self.dof)) if self.dof > 0 else None


@dataclass(frozen=True, slots=True)
class PriorConflict:
    """A prior that the measurements contradict: what they alone say, in mm or rad."""

    place: int
    value: float
    std: float
    sigmas: float
    """How far that is from the prior's mean, by both their standard deviations."""


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """The unknowns, the parameters among them first, and how well they are known."""

    x: Array
    """(P,), mm and rad."""
    covariance: Array | None
    """(P, P); of what was free to move. None where nothing tells it."""
    fixed_by_data: Mask
    """Parameters that take part in no combination held at its nominal value, (F,)."""
    seen: Observability
    """Of the parameters alone, with the priors."""
    data_seen: Observability
    """Of the parameters alone, by the measurements alone."""
    noise: ChiSquareTest
    kept: Mask
    """(blocks,)"""
    outliers: tuple[Outlier, ...]
    fit: Solution
    """How the solver ended."""
    contradictions: tuple[PriorConflict, ...] = ()
    """Known only where the measurements alone tell all parameters."""


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    """A fit with the problem as it was at last, whose priors weigh against the scatter found."""

    problem: LeastSquaresProblem
    robust: RobustFit
    noise: ChiSquareTest

    @property
    def x(self) -> Array:
        return self.problem.x(self.robust.fit.x)


def estimate(
    problem: LeastSquaresProblem, parameters: int, treatment: OutlierPolicy, *, trusted: bool
) -> Estimate:
    """Estimate with the first unknowns being parameters, the others (a frame) nuisance.

    What neither data nor priors can tell is held where it starts, also if it comes to be told a
    little once the others have moved. `trusted`: whether the stated
    noise gives the standard deviations while a test of χ² believes it; otherwise the scatter does.
    Raises `NoSolution` when the start has no answer.
    """
    at, kept = problem.data.start(), np.ones(problem.blocks, dtype=bool)
    for _ in range(CONSTRAINT_ROUNDS):
        seen = observability(project_out_nuisance(_jacobian(problem, at, kept), parameters))
        held = problem.inside(_subspace(problem, seen))
        agreed = reject_outliers(held) if treatment.exclude else Inliers(kept, ())
        solved = _solved(held, treatment.loss, agreed, trusted=trusted)
        at, kept = solved.x, agreed.kept
        found = observability(project_out_nuisance(_jacobian(solved.problem, at, kept), parameters))
        if found.rank >= seen.rank:
            break
    known = found if found.rank == seen.rank else seen
    by_data = _by_data_alone(solved.problem, at, kept, known, parameters)
    told = len(problem.priors) > 0 and by_data.rank == parameters
    return Estimate(
        at,
        _covariance(solved, kept),
        _identifiable(seen),
        known,
        by_data,
        solved.noise,
        kept,
        agreed.outliers,
        solved.robust.fit,
        tuple(_prior_conflicts(problem, at, kept)) if told else (),
    )


def _prior_conflicts(problem: LeastSquaresProblem, x: Array, kept: Mask) -> Iterator[PriorConflict]:
    """Priors far from where a step to the minimum of the measurements alone leads."""
    rows = problem.data.jacobian(x)[np.repeat(kept, problem.block)]
    misfit = problem.data.residual(x)[np.repeat(kept, problem.block)]
    freedom = len(rows) - len(x)
    if freedom < 1:
        return
    try:
        of_all = covariance(rows)
    except np.linalg.LinAlgError:
        return
    step = -of_all @ (rows.T @ misfit)
    scatter2 = max(1.0, float(np.sum((misfit + rows @ step) ** 2)) / freedom)
    alone, variance, priors = x + step, scatter2 * np.diag(of_all), problem.priors
    for place, mean, std in zip(priors.places.tolist(), priors.mean, priors.std, strict=True):
        sigmas = abs(alone[place] - mean) / np.sqrt(std**2 + variance[place])
        if sigmas > CONFLICT_SIGMAS:
            own_std = float(np.sqrt(variance[place]))
            yield PriorConflict(place, float(alone[place]), own_std, float(sigmas))


def chi_square_test(chi2: float, dof: int, scale: float | None) -> ChiSquareTest:
    """With the two-sided probability of such a χ²."""
    if dof < 1:
        return ChiSquareTest(chi2, dof, None, scale)
    p = 2.0 * min(float(chdtr(dof, chi2)), float(chdtrc(dof, chi2)))
    return ChiSquareTest(chi2, dof, min(p, 1.0), scale)


def _jacobian(problem: LeastSquaresProblem, x: Array, kept: Mask) -> Array:
    """∂(whitened measurements, priors)/∂unknowns, (M + K, P); zeros for what was left out."""
    data = problem.data.jacobian(x) * (np.repeat(kept, problem.block) / problem.unit)[:, None]
    return np.vstack([data, problem.priors.jacobian(len(x))])


def _subspace(problem: LeastSquaresProblem, seen: Observability) -> IdentifiableSubspace | None:
    """Steps that leave the unobservable combinations as they are; None when there are none."""
    count = len(seen.scale)
    if seen.rank == count:
        return None
    start = problem.data.start()
    others = len(start) - count
    directions = np.zeros((len(start), seen.rank + others))
    directions[:count, : seen.rank] = seen.seen_directions.T / seen.scale[:, None]
    directions[count:, seen.rank :] = np.eye(others)
    return IdentifiableSubspace(start, directions)


def _solved(problem: LeastSquaresProblem, loss: Loss, agreed: Inliers, *, trusted: bool) -> _Solved:
    """Solve; priors count against the scatter that the measurements turn out to have."""
    kept, first = agreed.kept, fit_inliers(problem, loss, agreed)
    tested = _tested(problem, first, kept)
    robust, scale = first, _scale(problem, first, loss, kept)
    for _ in range(VARIANCE_ROUNDS if len(problem.priors) else 0):
        unit = max(
            variance_scale(scale, tested, loss, trusted=trusted) or 1.0, LEAST_VARIANCE_FACTOR
        )
        if abs(unit / problem.unit - 1.0) < VARIANCE_SETTLED:
            break
        problem = problem.against(unit)
        robust = solve_robust(problem, loss, kept)
        scale = _scale(problem, robust, loss, kept)
    allowed = variance_scale(scale, tested, loss, trusted=trusted)
    return _Solved(problem, robust, chi_square_test(tested.chi2, tested.dof, allowed))


def _tested(problem: LeastSquaresProblem, robust: RobustFit, kept: Mask) -> ChiSquareTest:
    """χ² of what was kept, and of the priors, by the stated noise."""
    priors, x = problem.priors, problem.x(robust.fit.x)
    surprises = (x[priors.places] - priors.mean) / priors.std
    chi2 = float(np.sum(problem.sizes(robust.fit.x)[kept] ** 2) + surprises @ surprises)
    dof = int(problem.block * kept.sum()) + len(priors) - len(robust.fit.x)
    return chi_square_test(chi2, dof, None)


def variance_scale(
    scale: float | None, tested: ChiSquareTest, loss: Loss, *, trusted: bool
) -> float | None:
    """What σ are multiplied by: never less than what a trusted statement says."""
    if not trusted:
        return scale
    if scale is None or (tested.believable and loss.shape is LossShape.LINEAR):
        return 1.0
    return max(1.0, scale)


def _scale(problem: LeastSquaresProblem, robust: RobustFit, loss: Loss, kept: Mask) -> float | None:
    """Standard deviation of the whitened residuals as it acts on the unknowns.

    For a robust loss Huber's (1981, section 7.6): that of ρ' over the mean of ρ''. The freedom that
    the data have is what their leverages leave of them; priors have the rest.
    """
    rows = _reduced_jacobian(problem, robust, kept)
    basis, _ = np.linalg.qr(rows)
    measured = problem.block * problem.blocks
    freedom = problem.block * kept.sum() - float(np.sum(basis[:measured] ** 2))
    if freedom < LEAST_FREEDOM:
        return None
    sizes = problem.sizes(robust.fit.x)[kept]
    felt = float(np.sqrt(np.sum((robust.weights[kept] * sizes) ** 2) / freedom))
    square = (sizes / max(loss.scale * robust.unit, ROUNDING)) ** 2
    curvature = float(loss_curvature(loss.shape, square, problem.block).mean())
    if curvature < LEAST_CURVATURE:
        return None
    found = felt / curvature
    return found if loss.shape is LossShape.LINEAR else max(found, robust.unit)


def _reduced_jacobian(problem: LeastSquaresProblem, robust: RobustFit, kept: Mask) -> Array:
    """Rows by what is free to move, columns scaled, (M + K, R)."""
    rows = _jacobian(problem, problem.x(robust.fit.x), kept)
    if problem.subspace is not None:
        rows = rows @ problem.subspace.directions
    return np.asarray(rows / np.linalg.norm(rows, axis=0))


def _covariance(solved: _Solved, kept: Mask) -> Array | None:
    """(P, P), of the measurements at their allowed scatter and the priors as they are."""
    scale, problem = solved.noise.scale, solved.problem
    if scale is None:
        return None
    rows = _jacobian(problem.against(max(scale, ROUNDING)), solved.x, kept)
    directions = np.eye(len(solved.x)) if problem.subspace is None else problem.subspace.directions
    try:
        moving = covariance(rows @ directions)
    except np.linalg.LinAlgError:  # more was lost on the way than where it began
        return None
    return np.asarray(directions @ moving @ directions.T)


def _identifiable(seen: Observability) -> Mask:
    """Which parameters take part in no unobservable combination, (F,)."""
    return np.asarray(np.abs(seen.null_directions).max(axis=0, initial=0.0) < NOTHING_MOVES)


def _by_data_alone(
    problem: LeastSquaresProblem, x: Array, kept: Mask, with_priors: Observability, parameters: int
) -> Observability:
    if not len(problem.priors):
        return with_priors
    measured = problem.block * problem.blocks
    return observability(project_out_nuisance(_jacobian(problem, x, kept)[:measured], parameters))
