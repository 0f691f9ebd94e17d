"""Gauss-Newton on a stack of least-squares problems, each near enough to its minimum.

What a row gives depends on no other row. A row that is badly conditioned, or does not come nearer
with every step, is given up, for a solver that turns back.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from campaigns.arrays import Array, Index, Mask

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


class ProblemStack(Protocol):
    """Stack of least-squares problems of P unknowns and M residuals each."""

    def residual(self, x: Array, rows: Index) -> tuple[Array, Mask]:
        """Residuals (R, M) of these rows at unknowns (R, P), and which of them have an answer."""
        ...

    def step(self, x: Array, residual: Array, rows: Index) -> tuple[Array, Array, Mask]:
        """Steps (R, P) from residuals (R, M) where they were last asked for, as `normal_step`."""
        ...

    def change(self, step: Array, rows: Index) -> Array:
        """Change (R, M) of residuals by the last steps (R, P), which Jacobians tell.

        `rows` are some of those that the steps were asked of.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class StackSolution:
    """Minima of a stack of problems; rows that were given up say nothing else."""

    x: Array
    """(C, P)"""
    residual: Array
    """(C, M)"""
    converged: Mask
    evaluations: int
    """Of residuals, by the row that took most."""


def gauss_newton(
    problem: ProblemStack, start: Array, rows: Index | None = None, settled_at: float = SETTLED
) -> StackSolution:
    """Minima from unknowns (C, P), of these rows if not of all.

    A step behind which the next one is expected to be `settled_at` of the residual is the last.
    """
    x, asked = start.copy(), np.arange(len(start)) if rows is None else rows
    first, found = problem.residual(rows_of(x, asked), asked)
    (count, unknowns), measured = x.shape, first.shape[1]
    residual = with_rows(np.zeros((count, measured)), asked, first)
    sizes = lengths_of(residual)
    converged, last = np.zeros(count, dtype=bool), np.full(count, np.inf)
    active, evaluations = asked[found & (measured >= unknowns)], 1
    while evaluations <= STEPS and active.size:
        step, length, regular = problem.step(rows_of(x, active), rows_of(residual, active), active)
        before, least = last[active], NO_RESIDUAL * np.sqrt(measured)
        rate = np.where(np.isinf(before), 1.0, length / before)
        unit = np.maximum(sizes[active], least)
        ends = regular & (length <= CONTRACTION * before) & (length <= LINEAR * unit)
        ends &= length * rate <= settled_at * unit
        if ends.any():
            ended = active[ends]
            x[ended] += step[ends]
            left = rows_of(residual, ended) + problem.change(step[ends], ended)
            residual = with_rows(residual, ended, left)
            converged[ended] = True
            active, step, length, regular, rate, before = (
                each[~ends] for each in (active, step, length, regular, rate, before)
            )
            if not active.size:
                break
        further = rows_of(x, active) + step
        left, found = problem.residual(further, active)
        evaluations += 1
        size = lengths_of(left)
        unit = np.maximum(size, least)
        at_end = length <= ROUNDING * unit
        shrunk = size <= (1.0 + SAME_SIZE) * sizes[active]
        nearer = shrunk & (length <= CONTRACTION * before)
        settled = (length * rate <= settled_at * unit) | (at_end & ~nearer)
        good = found & regular & (nearer | at_end)
        if not good.any():
            break
        kept, those = active[good], np.flatnonzero(good)
        x, residual, sizes, last = (
            with_rows(old, kept, rows_of(new, those))
            for old, new in ((x, further), (residual, left), (sizes, size), (last, length))
        )
        converged[active[good & settled]] = True
        active = active[good & ~settled]
    return StackSolution(x, residual, converged, evaluations)


def lengths_of(vectors: Array) -> Array:
    """Lengths (R,) of vectors (R, M)."""
    return np.asarray(np.sqrt(np.einsum("rm,rm->r", vectors, vectors)))


def rows_of(stack: Array, rows: Index) -> Array:
    """Rows of a stack, without a copy where these are all."""
    return stack if len(rows) == len(stack) else stack[rows]


def with_rows(stack: Array, rows: Index, renewed: Array) -> Array:
    """Stack with these rows renewed, in place; the new ones themselves where these are all."""
    if len(rows) == len(stack):
        return renewed
    stack[rows] = renewed
    return stack


def product(jacobians: Array, step: Array) -> Array:
    """Changes (R, M) of residuals by steps (R, P), the same however many rows there are."""
    columns = np.ascontiguousarray(jacobians.swapaxes(1, 2))
    return np.asarray((step[:, None] @ columns)[:, 0])


def normal_step(jacobian: Array, residual: Array) -> tuple[Array, Array, Mask]:
    """Steps (R, P), their lengths in the space of the residuals, and which are to be trusted.

    By the normal equations of columns of unit length: their rounding may bend a step, but not
    where steps end.
    """
    turned = jacobian.swapaxes(1, 2)
    normal = turned @ jacobian
    scale = np.sqrt(np.diagonal(normal, axis1=1, axis2=2))
    scale = np.where(scale > 0.0, scale, np.inf)
    normal /= scale[:, :, None] * scale[:, None]
    gradient = (turned @ residual[:, :, None])[:, :, 0] / scale
    regular = _are_regular(normal)
    normal[~regular] = np.eye(scale.shape[1])
    unit_step = np.linalg.solve(normal, gradient[:, :, None])[:, :, 0]
    length = np.sqrt(np.maximum(np.sum(gradient * unit_step, axis=1), 0.0))
    return -unit_step / scale, length, regular


def _are_regular(normal: Array) -> Mask:
    """Whether no column of each of (R, P, P) is all but told by those before it."""
    try:
        pivots = np.diagonal(np.linalg.cholesky(normal), axis1=1, axis2=2)
    except np.linalg.LinAlgError:
        if len(normal) == 1:
            return np.zeros(1, dtype=bool)
        return np.concatenate([_are_regular(each[None]) for each in normal])
    return np.asarray((pivots > LEAST_PIVOT).all(axis=1))  # NaN is not
