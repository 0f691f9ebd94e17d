"""Least squares: measurements in blocks, which may be weighed, priors, which never are, the solver.

A block is what belongs together: the three whitened coordinates of a shot, or one distance.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy

from campaigns.arrays import Array, Index, Mask
from campaigns.estimation.gauss_newton import (
    CONTRACTION,
    SETTLED,
    STEPS,
    Residuals,
    gauss_newton,
    normal_step,
)
from campaigns.mechanisms.mechanism import NoSolution

STEP_TOLERANCE = 1e-7
COST_TOLERANCE = 1e-8
"""What is left is of the order of these squared, by the solver's convergence: far below any σ."""
EVALUATIONS = 100
CONVERGED, OUT_OF_EVALUATIONS = frozenset({1, 2, 3, 4}), 5
"""How MINPACK says that it ended."""
INFEASIBLE_FACTOR = 1e6
"""Times the largest residual of the start: every residual where the mechanism has no assembly, so
that the solver turns back."""
WORTH_A_STEP = 0.3
"""Part of the residual that a step without the unknowns of small effect may leave."""
COARSE_STEPS = 2
"""Without those, by the derivatives at the start: a third gains less than it costs."""
NEGLIGIBLE = 1e-6
"""Root mean square of residuals, mm or whitened, of which only rounding is left."""
STATIONARY_COSINE = 1e-3
"""Of the angle between the residual and a column of the Jacobian; a minimum reached gives 1e-6."""


@dataclass(frozen=True, slots=True, eq=False)
class Priors:
    """Gaussian knowledge about some of the unknowns, in mm and rad."""

    places: Index
    """Which unknowns, (K,)."""
    mean: Array
    std: Array

    @classmethod
    def none(cls) -> "Priors":
        """Nothing is known beforehand."""
        return cls(np.empty(0, dtype=np.intp), np.empty(0), np.empty(0))

    def __len__(self) -> int:
        return len(self.places)

    def residual(self, x: Array) -> Array:
        """Whitened differences from the means, (K,)."""
        return np.asarray((x[self.places] - self.mean) / self.std)

    def jacobian(self, unknowns: int) -> Array:
        """∂(whitened prior residual)/∂x, (K, P)."""
        jacobian = np.zeros((len(self), unknowns))
        jacobian[:, self.places] = np.diag(1.0 / self.std)
        return jacobian


@dataclass(frozen=True, slots=True, eq=False)
class IdentifiableSubspace:
    """Subspace in which a fit may go: x = origin + directions @ y."""

    origin: Array
    """(P,)"""
    directions: Array
    """(P, R)"""

    def x(self, y: Array) -> Array:
        """The unknowns (P,) of a place (R,) in it."""
        return np.asarray(self.origin + self.directions @ y)


@dataclass(frozen=True, slots=True, eq=False)
class LeastSquaresProblem:
    """Whitened measurements in blocks of equal size, and what is known without them.

    What a solver moves, y, are the unknowns x themselves, or places in a subspace of them.
    """

    data: Residuals
    block: int
    priors: Priors
    sigma0: float = 1.0
    """Square root of the variance factor: standard deviation of the whitened residuals against
    which the priors weigh."""
    subspace: IdentifiableSubspace | None = None
    """None: every unknown is free."""
    weights: Array | None = None
    """Of the measurements, (blocks,), at least zero; None: they all count alike."""

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return self.data.rows // self.block

    @property
    def rows(self) -> int:
        """The data's, and one a prior."""
        return self.data.rows + len(self.priors)

    def start(self) -> Array:
        """Beginning of the data's unknowns; of a subspace its origin."""
        if self.subspace is None:
            return self.data.start()
        return np.zeros(self.subspace.directions.shape[1])

    def fine_unknowns(self) -> Mask:
        """The data's; in a subspace none stands alone."""
        if self.subspace is None:
            return self.data.fine_unknowns()
        return np.zeros(self.subspace.directions.shape[1], dtype=bool)

    def residual(self, y: Array) -> Array:
        """The data's rows, then one a prior, (M + K,); raises `NoSolution`."""
        x = self.x(y)
        data = self._weighed(self.data.residual(x))
        return np.concatenate([data, self.priors.residual(x)]) if len(self.priors) else data

    def jacobian(self, y: Array) -> Array:
        """(M + K, R)."""
        x = self.x(y)
        jacobian = self._weighed(self.data.jacobian(x))
        if len(self.priors):
            jacobian = np.vstack([jacobian, self.priors.jacobian(len(x))])
        return jacobian if self.subspace is None else jacobian @ self.subspace.directions

    def x(self, y: Array) -> Array:
        """The unknowns (P,) of what a solver moves."""
        return y if self.subspace is None else self.subspace.x(y)

    def sizes(self, y: Array) -> Array:
        """Length of each block's whitened residual, whatever its weight, (blocks,)."""
        return block_norms(self.data.residual(self.x(y)), self.block)

    def weighted(self, weights: Array) -> "LeastSquaresProblem":
        """The same with weights (blocks,) of the measurements."""
        return replace(self, weights=weights)

    def _weighed(self, rows: Array) -> Array:
        """Rows (M,) or (M, P) of the measurements times the square roots of their weights."""
        if self.sigma0 == 1.0 and (self.weights is None or np.all(self.weights == 1.0)):
            return rows
        weights = np.ones(self.blocks) if self.weights is None else self.weights
        root = np.repeat(np.sqrt(weights / self.sigma0**2), self.block)
        return np.asarray((rows.T * root).T)


def block_norms(residual: Array, block: int) -> Array:
    """Length of each block's residual, (blocks,)."""
    return np.asarray(np.linalg.norm(residual.reshape(-1, block), axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Solution where the solver ended."""

    x: Array
    """(P,), mm and rad."""
    residual: Array
    """(M,)"""
    jacobian: Array
    """(M, P), from which the last step was taken, which was a short one."""
    converged: bool
    evaluations: int
    message: str
    """One sentence of explanation."""


def solve(
    problem: Residuals,
    evaluations: int = EVALUATIONS,
    *,
    start: Array | None = None,
    spent: int = 0,
    settled_at: float = SETTLED,
) -> Solution:
    """Least squares from `start`, else from the problem's own, within a number of evaluations.

    By Gauss-Newton where its steps lead straight to the minimum, else by Levenberg-Marquardt.
    Also from the problem's own where `start` has no answer, as an odd robot may have found it on
    its way only. `spent` are those that it took to find `start`: they count in what is told. As
    `gauss_newton` has it, the last step is the one behind which the next is expected to be
    `settled_at` of the residual. Raises `NoSolution` when the problem's own start has no answer.
    """
    begin, first, stepped = _begun(problem, start)
    spent += stepped
    if evaluations > STEPS:
        found = gauss_newton(problem, begin, settled_at)
        if found.converged:
            used = spent + found.evaluations
            fit = Solution(
                found.x,
                found.residual,
                found.jacobian,
                converged=True,
                evaluations=used,
                message=_explain(min(CONVERGED), used),
            )
            return _checked(fit)
    beyond = np.full(
        len(first), INFEASIBLE_FACTOR * max(1.0, float(np.abs(first).max(initial=0.0)))
    )

    def residual(x: Array) -> Array:
        try:
            return problem.residual(x)
        except NoSolution:
            return beyond

    # MINPACK's LM, scaled by the Jacobian; least_squares wraps the same in a tenth of a fit's time
    x, _, ended, _, status = scipy.optimize.leastsq(
        residual,
        begin,
        Dfun=problem.jacobian,
        xtol=STEP_TOLERANCE,
        ftol=COST_TOLERANCE,
        gtol=STEP_TOLERANCE,
        maxfev=evaluations,
        full_output=True,
    )
    used, converged, left = spent + int(ended["nfev"]), status in CONVERGED, ended["fvec"]
    if converged and evaluations > STEPS:  # it ends sooner than Gauss-Newton
        found = gauss_newton(problem, x)
        used += found.evaluations
        if found.converged:
            x, left = found.x, found.residual
    message = _explain(int(status), used)
    return _checked(Solution(x, left, problem.jacobian(x), converged, used, message))


def _begun(problem: Residuals, start: Array | None) -> tuple[Array, Array, int]:
    """Unknowns to begin with, the residual there, and how many steps led to them.

    Of the problem's own start: two of the unknowns that matter most, where the first leads far, by
    the same derivatives: while the others are at their start an evaluation is a cheap one.
    """
    if start is not None:
        try:
            return start, problem.residual(start), 0
        except NoSolution:
            pass
    own, fine = problem.start(), problem.fine_unknowns()
    first = problem.residual(own)
    if not fine.any() or fine.all() or len(first) < len(own):
        return own, first, 0
    coarse, at, left = problem.jacobian(own)[:, ~fine], own, first
    for steps in range(COARSE_STEPS):
        step, _, regular = normal_step(coarse, left)
        further = at.copy()
        further[~fine] += step
        part = CONTRACTION if steps else WORTH_A_STEP
        try:
            residual = problem.residual(further)
        except NoSolution:
            return at, left, steps
        if not regular or not np.linalg.norm(residual) <= part * np.linalg.norm(left):
            return at, left, steps
        at, left = further, residual
    return at, left, COARSE_STEPS


def _checked(fit: Solution) -> Solution:
    """A solver that stopped before the edge of what can be assembled has not converged.

    At a minimum the residual is perpendicular to every column of the Jacobian, unless it is so
    small that only rounding is left of it.
    """
    size = float(np.linalg.norm(fit.residual))
    if not fit.converged or size <= NEGLIGIBLE * np.sqrt(len(fit.residual)):
        return fit
    columns = np.linalg.norm(fit.jacobian, axis=0)
    cosines = np.abs(fit.jacobian.T @ fit.residual) / (np.where(columns > 0.0, columns, 1.0) * size)
    if cosines.max() <= STATIONARY_COSINE:
        return fit
    message = "not converged: the solver stopped where the shots still fit better nearby"
    return replace(fit, converged=False, message=message)


def _explain(status: int, evaluations: int) -> str:
    if status in CONVERGED:
        return f"converged after {evaluations} evaluations"
    if status == OUT_OF_EVALUATIONS:
        return f"not converged: stopped after {evaluations} evaluations"
    return "not converged: the solver found its input improper"
