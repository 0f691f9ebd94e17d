"""Gauss-Newton on a least-squares problem, near enough to its minimum.

A problem that is badly conditioned, or does not come nearer with every step, is given up, for a
solver that turns back.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from campaigns.arrays import Array, Mask
from campaigns.mechanisms.mechanism import NoSolution

STEPS = 12
CONTRACTION = 0.5
"""Part of a step that the next one may have at most."""
SETTLED = 1e-10
"""Expected length of the next step over that of the residual."""
LINEAR = 1e-5
"""Length of a last step over that of the residual, behind which the Jacobian tells the residual as
well: what is bent of it is less than rounding."""
ROUNDING = 1e-7
"""Length of a step over that of the residual that rounding may be all of."""
SAME_SIZE = 1e-9
"""Relative growth of a residual that rounding may be all of."""
NO_RESIDUAL = 1e-9
"""Root mean square of residuals, mm or whitened, beside which no shorter ones are looked at."""
LEAST_PIVOT = 1e-5
"""Part of a column that the columns before it must leave: its square is lost to rounding."""


class Residuals(Protocol):
    """Residuals as functions of the unknowns x, in mm and rad."""

    @property
    def rows(self) -> int:
        """Number of residuals, M."""
        ...

    def start(self) -> Array:
        """Unknowns to begin with, (P,)."""
        ...

    def fine_unknowns(self) -> Mask:
        """Those of small effect whose start makes the model cheaper, (P,): a first step waits."""
        ...

    def residual(self, x: Array) -> Array:
        """(M,); raises `NoSolution` where the model has no answer."""
        ...

    def jacobian(self, x: Array) -> Array:
        """(M, P)."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Minimum:
    """Minimum of a problem; of one that was given up it says nothing else."""

    x: Array
    """(P,)"""
    residual: Array
    """(M,)"""
    jacobian: Array
    """(M, P), from which the last step was taken."""
    converged: bool
    evaluations: int
    """Of residuals."""


def gauss_newton(problem: Residuals, start: Array, settled_at: float = SETTLED) -> Minimum:
    """Minimum from unknowns (P,).

    A step behind which the next one is expected to be `settled_at` of the residual is the last.
    """
    x, residual, jacobian = start, _residual(problem, start), np.empty((0, len(start)))
    if residual is None:
        return Minimum(x, np.empty(0), jacobian, converged=False, evaluations=1)
    size, last, least = _length(residual), np.inf, NO_RESIDUAL * np.sqrt(len(residual))
    evaluations, is_settled = 1, False
    while evaluations <= STEPS and not is_settled and len(residual) >= len(x):
        jacobian = problem.jacobian(x)
        step, length, regular = normal_step(jacobian, residual)
        rate, unit = (1.0 if np.isinf(last) else length / last), max(size, least)
        nears = length <= CONTRACTION * last
        if regular and nears and length <= LINEAR * unit and length * rate <= settled_at * unit:
            residual = residual + jacobian @ step
            return Minimum(x + step, residual, jacobian, converged=True, evaluations=evaluations)
        left = _residual(problem, x + step)
        if left is None:
            break
        evaluations += 1
        left_size = _length(left)
        unit = max(left_size, least)
        at_end = length <= ROUNDING * unit
        nearer = nears and left_size <= (1.0 + SAME_SIZE) * size
        if not (regular and (nearer or at_end)):
            break
        is_settled = length * rate <= settled_at * unit or (at_end and not nearer)
        x, residual, size, last = x + step, left, left_size, length
    return Minimum(x, residual, jacobian, is_settled, evaluations)


def _residual(problem: Residuals, x: Array) -> Array | None:
    """None where the model has no answer."""
    try:
        return problem.residual(x)
    except NoSolution:
        return None


def _length(vector: Array) -> float:
    return math.sqrt(float(vector @ vector))


def normal_step(jacobian: Array, residual: Array) -> tuple[Array, float, bool]:
    """Step (P,), its length in the space of the residuals, and whether it is to be trusted.

    By the normal equations of columns of unit length: their rounding may bend a step, but not
    where steps end.
    """
    normal = jacobian.T @ jacobian
    scale = np.sqrt(np.diag(normal))
    scale = np.where(scale > 0.0, scale, np.inf)
    normal /= np.outer(scale, scale)
    gradient = (jacobian.T @ residual) / scale
    if not _is_regular(normal):
        return np.zeros(len(scale)), 0.0, False
    unit_step = np.linalg.solve(normal, gradient)
    return -unit_step / scale, math.sqrt(max(float(gradient @ unit_step), 0.0)), True


def _is_regular(normal: Array) -> bool:
    """Whether no column of (P, P) is all but told by those before it."""
    try:
        pivots = np.diag(np.linalg.cholesky(normal))
    except np.linalg.LinAlgError:
        return False
    return bool((pivots > LEAST_PIVOT).all())  # NaN is not
