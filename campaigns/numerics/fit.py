"""The solver: Levenberg-Marquardt with analytic Jacobian, and an answer that says how it ended."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from campaigns.numerics.geometry import Array
from campaigns.numerics.par4 import NoAssembly
from campaigns.numerics.residuals import Residuals

TOLERANCE = 1e-12
EVALUATIONS = 100
OUT_OF_THE_MODEL_MM = 1e6
"""Residual reported where the mechanism cannot be assembled, so that the solver turns back."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Where the solver ended."""

    x: Array
    residual: Array
    jacobian: Array
    converged: bool
    evaluations: int
    message: str
    """One sentence of explanation."""


def solve(problem: Residuals) -> Fit:
    """Least squares from the problem's own start. Raises `NoAssembly` when that has no answer."""
    start = problem.start()
    rows = len(problem.residual(start))

    def residual(x: Array) -> Array:
        try:
            return problem.residual(x)
        except NoAssembly:
            return np.full(rows, OUT_OF_THE_MODEL_MM)

    answer = least_squares(
        residual,
        start,
        jac=problem.jacobian,
        method="lm",
        x_scale="jac",
        xtol=TOLERANCE,
        ftol=TOLERANCE,
        gtol=TOLERANCE,
        max_nfev=EVALUATIONS,
    )
    return Fit(
        np.asarray(answer.x),
        np.asarray(answer.fun),
        problem.jacobian(answer.x),
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
