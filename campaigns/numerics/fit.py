"""The solver: Levenberg-Marquardt by analytic Jacobian, and an answer that says how it ended."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from campaigns.numerics.geometry import Array
from campaigns.numerics.par4 import NoAssembly
from campaigns.numerics.residuals import Residuals

STEP_TOLERANCE = 1e-12
COST_TOLERANCE = 1e-11
"""Just above the rounding of a cost of micrometres made of distances of metres."""
EVALUATIONS = 100
OUT_OF_THE_MODEL = 1e6
"""Every residual, mm or whitened, where the mechanism has no assembly: the solver turns back."""


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


def solve(problem: Residuals, evaluations: int = EVALUATIONS) -> Fit:
    """Least squares from the problem's own start, within a number of evaluations.

    Raises `NoAssembly` when that start has no answer.
    """
    start = problem.start()
    rows = len(problem.residual(start))

    def residual(x: Array) -> Array:
        try:
            return problem.residual(x)
        except NoAssembly:
            return np.full(rows, OUT_OF_THE_MODEL)

    answer = least_squares(
        residual,
        start,
        jac=problem.jacobian,
        method="lm",
        x_scale="jac",
        xtol=STEP_TOLERANCE,
        ftol=COST_TOLERANCE,
        gtol=STEP_TOLERANCE,
        max_nfev=evaluations,
    )
    return Fit(
        np.asarray(answer.x),
        np.asarray(answer.fun),
        np.asarray(answer.jac),
        bool(answer.status > 0),
        int(answer.nfev),
        _explain(int(answer.status), int(answer.nfev)),
    )


def _explain(status: int, evaluations: int) -> str:
    if status > 0:
        return f"converged after {evaluations} evaluations"
    if status == 0:
        return f"not converged: stopped after {evaluations} evaluations"
    return "not converged: the solver found its input improper"
