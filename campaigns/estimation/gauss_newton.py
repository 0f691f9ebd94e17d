"""Gauss-Newton on a stack of least-squares problems, each near enough to its minimum.

What a row gives depends on no other row. A step solves the seminormal equations RᵀR dx = -Jᵀr;
their triangle R is kept once steps are short, for it hardly changes there. A row that is badly
conditioned, or does not come nearer with every step, is given up, for a solver that turns back.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from campaigns.arrays import Array, Index, Mask

STEPS = 10
CONTRACTION = 0.5
"""Part of a step that the next one may have at most."""
KEPT_BELOW = 1.0
"""Length of a step over that of the residual below which the triangle is kept."""
SETTLED = 1e-9
"""Expected length of the next step over that of the residual."""
ROUNDING = 1e-7
"""Length of a step over that of the residual that rounding may be all of."""
SAME_SIZE = 1e-9
"""Relative growth of a residual that rounding may be all of."""
NO_RESIDUAL = 1e-9
"""Root mean square of residuals, mm or whitened, beside which no shorter ones are looked at."""
LEAST_PIVOT = 1e-5
"""Part of a column that the columns before it must leave: its square is lost to rounding."""


class ProblemStack(Protocol):
    """Stack of least-squares problems of P unknowns and M residuals each."""

    def residual(self, x: Array, rows: Index) -> tuple[Array, Mask]:
        """Residuals (R, M) of these rows at unknowns (R, P), and which of them have an answer."""
        ...

    def jacobian(self, x: Array, rows: Index) -> Array:
        """(R, M, P) where residuals were last asked for."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class StackSolution:
    """Minima of a stack of problems; rows that were given up say nothing else."""

    x: Array
    """(C, P)"""
    residual: Array
    """(C, M)"""
    jacobian: Array
    """(C, M, P), from which the last step was taken: it is too short to change them."""
    converged: Mask
    evaluations: int
    """Of residuals, by the row that took most."""


def gauss_newton(problem: ProblemStack, start: Array) -> StackSolution:
    """Minima from unknowns (C, P)."""
    x, every = start.copy(), np.arange(len(start))
    residual, found = problem.residual(x, every)
    residual = np.array(residual)
    (count, unknowns), measured = x.shape, residual.shape[1]
    converged, last = np.zeros(count, dtype=bool), np.full(count, np.inf)
    triangle = np.empty((count, unknowns, unknowns))
    jacobians = np.empty((count, measured, unknowns))
    is_far, active = np.ones(count, dtype=bool), every[found & (measured >= unknowns)]
    evaluations = 1
    while evaluations <= STEPS and active.size:
        jacobian = problem.jacobian(_of(x, active), active)
        jacobians[active] = jacobian
        far = is_far[active]
        triangle[active[far]] = np.linalg.qr(_of(jacobian, np.flatnonzero(far)), mode="r")
        regular = _regular(_of(triangle, active))
        if not regular.all():
            active, jacobian = active[regular], jacobian[regular]
        gradient = (_of(residual, active)[:, None] @ jacobian).swapaxes(1, 2)
        along = np.linalg.solve(_of(triangle, active).swapaxes(1, 2), gradient)
        further = _of(x, active) - np.linalg.solve(_of(triangle, active), along)[:, :, 0]
        left, found = problem.residual(further, active)
        evaluations += 1
        length, before = np.linalg.norm(along[:, :, 0], axis=1), last[active]
        size = np.linalg.norm(left, axis=1)
        unit = np.maximum(size, NO_RESIDUAL * np.sqrt(measured))
        at_end = length <= ROUNDING * unit
        shrunk = size <= (1.0 + SAME_SIZE) * np.linalg.norm(_of(residual, active), axis=1)
        nearer = shrunk & (length <= CONTRACTION * before)
        rate = np.where(np.isinf(before), 1.0, length / before)
        settled = (length * rate <= SETTLED * unit) | (at_end & ~nearer)
        good = found & (nearer | at_end)
        kept = active[good]
        x[kept], residual[kept], last[kept] = further[good], left[good], length[good]
        is_far[kept] = (length > KEPT_BELOW * unit)[good]
        converged[active[good & settled]] = True
        active = active[good & ~settled]
    return StackSolution(x, residual, jacobians, converged, evaluations)


def _of(stack: Array, rows: Index) -> Array:
    """Rows of a stack, without a copy where these are all."""
    return stack if len(rows) == len(stack) else stack[rows]


def _regular(triangles: Array) -> Mask:
    """Rows whose triangles (R, P, P) can be solved."""
    pivots = np.abs(np.diagonal(triangles, axis1=1, axis2=2))
    lengths = np.linalg.norm(triangles, axis=1)
    return np.asarray((pivots > LEAST_PIVOT * lengths).all(axis=1))  # NaN is not
