"""The solver: Levenberg-Marquardt by analytic Jacobian, and an answer that says how it ended."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import leastsq

from campaigns.numerics.geometry import Array
from campaigns.numerics.par4 import NoAssembly
from campaigns.numerics.residuals import Residuals

STEP_TOLERANCE = 1e-7
COST_TOLERANCE = 1e-8
"""What is left is of the order of these squared, by the solver's convergence: far below any σ."""
EVALUATIONS = 100
CONVERGED, OUT_OF_EVALUATIONS = frozenset({1, 2, 3, 4}), 5
"""How MINPACK says that it ended."""
FURTHER_OFF = 1e6
"""Times the largest residual of the start: every residual where the mechanism has no assembly, so
that the solver turns back."""
NEGLIGIBLE = 1e-6
"""Root mean square of residuals, mm or whitened, of which only rounding is left."""
STATIONARY_COSINE = 1e-3
"""Of the angle between the residual and a column of the Jacobian; a minimum reached gives 1e-6."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
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
) -> Fit:
    """Least squares from `start`, else from the problem's own, within a number of evaluations.

    Also from the problem's own where `start` has no answer, as an odd robot may have found it on
    its way only. `spent` are those that it took to find `start`: they count in what is told. Raises
    `NoAssembly` when the problem's own start has no answer.
    """
    begin, first = _begun(problem, start)
    beyond = np.full(len(first), FURTHER_OFF * max(1.0, float(np.abs(first).max(initial=0.0))))

    def residual(x: Array) -> Array:
        try:
            return problem.residual(x)
        except NoAssembly:
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
    return _checked(Fit(x, ended["fvec"], jacobian, converged, used, message))


def _begun(problem: Residuals, start: Array | None) -> tuple[Array, Array]:
    """Where to begin, and the residual there."""
    if start is not None:
        try:
            return start, problem.residual(start)
        except NoAssembly:
            pass
    own = problem.start()
    return own, problem.residual(own)


def _checked(fit: Fit) -> Fit:
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
