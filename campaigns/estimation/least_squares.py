"""What is fitted: measurements in blocks, which may be weighed, and priors, which never are.

A block is what belongs together: the three whitened coordinates of a shot, or one distance.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import leastsq

from campaigns.arrays import Array, Index
from campaigns.estimation.residuals import Residuals, WithPriors
from campaigns.mechanisms.par4 import NoSolution


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

    def jacobian(self, unknowns: int) -> Array:
        """∂(whitened prior residual)/∂x, (K, P)."""
        rows = np.zeros((len(self), unknowns))
        rows[np.arange(len(self)), self.places] = 1.0 / self.std
        return rows


@dataclass(frozen=True, slots=True, eq=False)
class WeightedResiduals:
    """A least-squares problem with a weight on every block."""

    data: Residuals
    block: int
    weights: Array
    """(blocks,), at least zero."""

    @property
    def rows(self) -> int:
        """The data's."""
        return self.data.rows

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
class IdentifiableSubspace:
    """Where a fit may go: x = origin + directions @ y."""

    origin: Array
    """(P,)"""
    directions: Array
    """(P, R)"""

    def x(self, y: Array) -> Array:
        """The unknowns (P,) of a place (R,) in it."""
        return np.asarray(self.origin + self.directions @ y)


@dataclass(frozen=True, slots=True, eq=False)
class ReducedProblem:
    """A problem whose unknowns are the places in a subspace."""

    whole: Residuals
    subspace: IdentifiableSubspace

    @property
    def rows(self) -> int:
        """The whole problem's."""
        return self.whole.rows

    def start(self) -> Array:
        """The origin, (R,)."""
        return np.zeros(self.subspace.directions.shape[1])

    def residual(self, y: Array) -> Array:
        """The whole problem's, (M,)."""
        return self.whole.residual(self.subspace.x(y))

    def jacobian(self, y: Array) -> Array:
        """(M, R)."""
        return np.asarray(self.whole.jacobian(self.subspace.x(y)) @ self.subspace.directions)


@dataclass(frozen=True, slots=True, eq=False)
class LeastSquaresProblem:
    """Whitened measurements in blocks of equal size, and what is known without them."""

    data: Residuals
    block: int
    priors: Priors
    unit: float = 1.0
    """Standard deviation of the whitened residuals against which the priors weigh."""
    subspace: IdentifiableSubspace | None = None
    """None: every unknown is free."""

    @property
    def blocks(self) -> int:
        """How many there are."""
        return self.data.rows // self.block

    def weighted(self, weights: Array) -> Residuals:
        """What a solver takes; `weights` (blocks,) are of the measurements alone."""
        data = WeightedResiduals(self.data, self.block, weights / self.unit**2)
        priors = self.priors
        known = WithPriors(data, priors.places, priors.mean, priors.std) if len(priors) else data
        return known if self.subspace is None else ReducedProblem(known, self.subspace)

    def x(self, solved: Array) -> Array:
        """The unknowns (P,) of what a solver found."""
        return solved if self.subspace is None else self.subspace.x(solved)

    def sizes(self, solved: Array) -> Array:
        """Length of each block's whitened residual where a solver is, (blocks,)."""
        return block_norms(self.data.residual(self.x(solved)), self.block)

    def against(self, unit: float) -> "LeastSquaresProblem":
        """The same with priors weighed against residuals of another standard deviation."""
        return replace(self, unit=unit)

    def inside(self, subspace: IdentifiableSubspace | None) -> "LeastSquaresProblem":
        """The same, free to move in a subspace only."""
        return replace(self, subspace=subspace)


def block_norms(residual: Array, block: int) -> Array:
    """Length of each block's residual, (blocks,)."""
    return np.asarray(np.linalg.norm(residual.reshape(-1, block), axis=1))


STEP_TOLERANCE = 1e-7
COST_TOLERANCE = 1e-8
"""What is left is of the order of these squared, by the solver's convergence: far below any σ."""
EVALUATIONS = 100
CONVERGED, OUT_OF_EVALUATIONS = frozenset({1, 2, 3, 4}), 5
"""How MINPACK says that it ended."""
INFEASIBLE_FACTOR = 1e6
"""Times the largest residual of the start: every residual where the mechanism has no assembly, so
that the solver turns back."""
NEGLIGIBLE = 1e-6
"""Root mean square of residuals, mm or whitened, of which only rounding is left."""
STATIONARY_COSINE = 1e-3
"""Of the angle between the residual and a column of the Jacobian; a minimum reached gives 1e-6."""


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Where the solver ended."""

    x: Array
    """(P,), mm and rad."""
    residual: Array
    """(M,)"""
    jacobian: Array
    """(M, P)"""
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
) -> Solution:
    """Least squares from `start`, else from the problem's own, within a number of evaluations.

    Also from the problem's own where `start` has no answer, as an odd robot may have found it on
    its way only. `spent` are those that it took to find `start`: they count in what is told. Raises
    `NoSolution` when the problem's own start has no answer.
    """
    begin, first = _begun(problem, start)
    beyond = np.full(
        len(first), INFEASIBLE_FACTOR * max(1.0, float(np.abs(first).max(initial=0.0)))
    )

    def residual(x: Array) -> Array:
        try:
            return problem.residual(x)
        except NoSolution:
            return beyond

    # MINPACK's LM, scaled by the Jacobian; least_squares wraps the same in a tenth of a fit's time
    x, _, ended, _, status = leastsq(
        residual,
        begin,
        Dfun=problem.jacobian,
        xtol=STEP_TOLERANCE,
        ftol=COST_TOLERANCE,
        gtol=STEP_TOLERANCE,
        maxfev=evaluations,
        full_output=True,
    )
    used, converged = spent + int(ended["nfev"]), status in CONVERGED
    message = _explain(int(status), used)
    jacobian = problem.jacobian(x)
    return _checked(Solution(x, ended["fvec"], jacobian, converged, used, message))


def _begun(problem: Residuals, start: Array | None) -> tuple[Array, Array]:
    """Where to begin, and the residual there."""
    if start is not None:
        try:
            return start, problem.residual(start)
        except NoSolution:
            pass
    own = problem.start()
    return own, problem.residual(own)


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
