"""Change during a campaign: tests of a step, or a drift, at every place in time and of every cause.

For each cause (one joint's offset, one arm's length, the tracker's frame) and each shot k an F test
of a step from k on, in the linearised fit whitened with the whole covariance of every shot,
Bonferroni over all tests.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import fdtrc

from campaigns.arrays import Array

SIGNIFICANCE = 1e-3
"""Chance of a false alarm over all tests of a campaign."""
FEWEST_BEYOND = 3
"""Shots before and after a step, so that no single gross error makes one."""

CauseKind = Literal["joint", "length", "frame", "drift"]


@dataclass(frozen=True, slots=True, eq=False)
class Cause:
    """Thing that may change: its columns ∂point/∂change, (N, 3, m)."""

    kind: CauseKind
    name: str
    columns: Array


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """Change that the shots show, by how much, and between which of them."""

    kind: CauseKind
    name: str
    after: int
    """Place of the last shot before it, in the order of time."""
    size: Array
    """By the cause's columns, (m,); of a drift from the first shot to the last."""
    std: Array
    p: float
    """Chance of good shots to show as much anywhere."""


def detect_change(
    whitened_residual: Array, whitened_jacobian: Array, causes: Mapping[str, Cause], root: Array
) -> Change | None:
    """Most likely change in shots that stand in the order of time; None where chance will do.

    Residual (N, 3) and Jacobian (N, 3, P) are whitened by the inverse of `root` (N, 3, 3).
    """
    count = len(whitened_residual)
    flat = whitened_jacobian.reshape(-1, whitened_jacobian.shape[-1])
    norms = np.linalg.norm(flat, axis=0)
    basis, kept = _orthonormal(flat / np.where(norms > 0.0, norms, 1.0))
    freedom = 3 * count - kept
    left = whitened_residual.ravel() - basis @ (basis.T @ whitened_residual.ravel())
    chi2 = float(left @ left)
    if freedom < 2 * FEWEST_BEYOND or count < 2 * FEWEST_BEYOND or chi2 <= 0.0:
        return None
    by_shot = basis.reshape(count, 3, -1)
    found: list[tuple[float, Cause, int, Array, Array]] = []
    tests = 0
    for cause in causes.values():
        columns = np.asarray(np.linalg.solve(root, cause.columns), dtype=np.float64)
        m = columns.shape[-1]
        for after, own, gained in _tests(cause, columns, left.reshape(count, 3), by_shot):
            tests += 1
            size, gain, covariance = _solved(own, gained)
            rest = max(chi2 - gain, np.finfo(np.float64).tiny) / (freedom - m)
            p = float(fdtrc(m, freedom - m, max(gain, 0.0) / m / rest))
            found.append((p, cause, after, size, np.sqrt(np.abs(rest * np.diag(covariance)))))
    if not found:
        return None
    p, cause, after, size, std = min(found, key=lambda each: each[0])
    if p * tests >= SIGNIFICANCE:
        return None
    return Change(cause.kind, cause.name, after, -size, std, min(1.0, p * tests))


def _tests(
    cause: Cause, columns: Array, left: Array, basis: Array
) -> Iterator[tuple[int, Array, Array]]:
    """Place, normal matrix (m, m) and right side (m,) of each test of a cause."""
    count = len(columns)
    if cause.kind == "drift":
        along = columns * np.linspace(0.0, 1.0, count)[:, None, None]
        shared = np.einsum("nkp,nkm->pm", basis, along)
        own = np.einsum("nkl,nkm->lm", along, along) - shared.T @ shared
        yield 0, own, np.einsum("nkm,nk->m", along, left)
        return
    own = _from_there_on(np.einsum("nkl,nkm->nlm", columns, columns))
    shared = _from_there_on(np.einsum("nkp,nkm->npm", basis, columns))
    gained = _from_there_on(np.einsum("nkm,nk->nm", columns, left))
    normal = own - shared.swapaxes(1, 2) @ shared
    for first in range(FEWEST_BEYOND, count - FEWEST_BEYOND + 1):
        yield first - 1, normal[first], gained[first]


def _from_there_on(each: Array) -> Array:
    """Sums of a shot and all that follow it."""
    return np.asarray(np.cumsum(each[::-1], axis=0)[::-1])


def _solved(normal: Array, gained: Array) -> tuple[Array, float, Array]:
    """Step, what it takes off χ², and its covariance for unit variance."""
    inverse = np.asarray(np.linalg.pinv(normal, rcond=1e-10, hermitian=True), dtype=np.float64)
    size = inverse @ gained
    return size, float(gained @ size), inverse


def _orthonormal(rows: Array) -> tuple[Array, int]:
    """Basis of the columns' space, and its dimension."""
    u, spread, _ = np.linalg.svd(rows, full_matrices=False)
    kept = int(np.sum(spread > spread[0] * 1e-11))
    return u[:, :kept], kept
