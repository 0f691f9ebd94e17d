"""What a fit knows and what it cannot: rank, condition, covariance, unobservable combinations."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from campaigns.arrays import Array, Mask

RANK_TOLERANCE = 1e-8
"""A singular value of the scaled Jacobian below this part of the largest counts as zero."""
ROUNDING = 1e-13
"""A column below this part of the longest is zero but for rounding."""
BLOCK_ROWS = 300
"""Rows of which a QR stays in the processor's cache."""
APART = 1e-3
"""Least over largest singular value of columns that are all well apart."""
SHARE_NAMED = 0.1
"""Parameters with at least this share in an unobservable combination are named in it."""


@dataclass(frozen=True, slots=True, eq=False)
class Observability:
    """Singular values of a column-scaled Jacobian, and the directions it tells nothing of."""

    singular_values: Array
    """(P,), from the largest."""
    rank: int
    directions: Array
    """Rows in scaled parameters, best known first, (P, P)."""
    scale: Array
    """Scaled parameter over parameter, (P,)."""
    rows: int
    """M."""

    @property
    def null_directions(self) -> Array:
        """Rows in scaled parameters, (P - rank, P)."""
        return self.directions[self.rank :]

    @property
    def identifiable_directions(self) -> Array:
        """Rows in scaled parameters, (rank, P)."""
        return self.directions[: self.rank]

    @property
    def condition(self) -> float:
        """Largest over smallest singular value; infinite when the rank is lost."""
        full = self.rank == len(self.singular_values)
        return float(self.singular_values[0] / self.singular_values[-1]) if full else float("inf")

    @property
    def indices(self) -> dict[str, float]:
        """O1…O5 (Sun & Hollerbach 2008) of the scaled Jacobian's singular values."""
        values = self.singular_values
        largest, least = float(values[0]), float(values[-1])
        if largest == 0.0:
            return dict.fromkeys(("O1", "O2", "O3", "O4", "O5"), 0.0)
        positive = least > 0.0
        return {
            "O1": float(np.exp(np.log(values).mean()) / np.sqrt(self.rows)) if positive else 0.0,
            "O2": least / largest,
            "O3": least,
            "O4": least**2 / largest,
            "O5": float(1.0 / np.sum(1.0 / values)) if positive else 0.0,
        }


def observability(jacobian: Array) -> Observability:
    """Rank and null space of a Jacobian (M, P) after column scaling."""
    norms = column_norms(jacobian)
    # a column of which only rounding is left must not be blown up to unit length
    scale = np.where(norms > ROUNDING * norms.max(initial=0.0), norms, 1.0)
    rows, wide = jacobian / scale, len(jacobian) < jacobian.shape[1]
    # a triangle has the singular values and directions of the whole, in a fraction of the time
    triangle = rows if wide else triangle_of(rows)
    _, values, directions = np.linalg.svd(triangle)
    values = np.concatenate([values, np.zeros(jacobian.shape[1] - len(values))])
    rank = int(np.sum(values > RANK_TOLERANCE * values[0]))
    return Observability(values, rank, directions, scale, len(jacobian))


def column_norms(rows: Array) -> Array:
    """Lengths (P,) of the columns of rows (M, P), without an array of all their squares."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->j", rows, rows)))


def triangle_of(rows: Array) -> Array:
    """Triangle R (P, P) with RᵀR = AᵀA of tall rows A (M, P), by QR.

    Of many rows block by block, which the processor's cache holds, and of the triangles of these
    (Demmel, Grigori, Hoemmen and Langou 2012).
    """
    whole = len(rows) // BLOCK_ROWS
    if whole < 2 or rows.shape[1] > BLOCK_ROWS:
        return np.asarray(np.linalg.qr(rows, mode="r"))
    blocks = rows[: whole * BLOCK_ROWS].reshape(whole, BLOCK_ROWS, -1)
    triangles = np.asarray(np.linalg.qr(blocks, mode="r")).reshape(-1, rows.shape[1])
    rest = rows[whole * BLOCK_ROWS :]
    return np.asarray(np.linalg.qr(np.concatenate([triangles, rest]), mode="r"))


def orthonormal_basis(columns: Array) -> Array:
    """Orthonormal basis (M, R) of the space of columns (M, P), those of no length left out."""
    norms = column_norms(columns)
    kept = norms > RANK_TOLERANCE * norms.max(initial=0.0)
    scaled = columns[:, kept] / norms[kept]
    if len(scaled) >= 2 * BLOCK_ROWS:  # a triangle tells as much, unless columns nearly depend
        _, spread, directions = np.linalg.svd(triangle_of(scaled))
        if spread.min(initial=np.inf) > APART * spread.max(initial=0.0):
            return np.asarray(scaled @ (directions.T / spread))
    u, spread, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(u[:, spread > RANK_TOLERANCE * spread.max(initial=0.0)])


def project_out_nuisance(jacobian: Array, count: int) -> Array:
    """∂/∂(first `count` unknowns) after the best fit of all others, (M, count).

    Least squares with it gives the parameters the same values and covariance as with the others
    among the unknowns (Frisch, Waugh and Lovell). A column of which only rounding is left is zero.
    """
    parameters, others = jacobian[:, :count], jacobian[:, count:]
    if others.shape[1] == 0:
        return parameters
    basis, _ = np.linalg.qr(others)
    alone = parameters - basis @ (basis.T @ parameters)
    lost = column_norms(alone) <= RANK_TOLERANCE * column_norms(parameters)
    return np.asarray(np.where(lost, 0.0, alone))


def unobservable_combinations(seen: Observability, names: tuple[str, ...]) -> list[tuple[str, ...]]:
    """The parameters that move together without any effect on the data, one tuple a lost direction.

    The null space has no preferred basis: rows are reduced so that each names as few as possible.
    """
    combinations = []
    for row in _sparse_rows(seen.null_directions[:, : len(names)]):
        named = np.flatnonzero(_named(row))
        combinations.append(tuple(names[place] for place in named))
    return combinations


def _sparse_rows(rows: Array) -> Array:
    """The same span with many zeros: Gauss-Jordan, then what each row gains from each other one."""
    sparse = _gauss_jordan(rows)
    for row, other in permutations(range(len(sparse)), 2):
        sparse[row] = min(
            _combined(sparse[row], sparse[other]), key=lambda candidate: _named(candidate).sum()
        )
    return sparse


def _gauss_jordan(rows: Array) -> Array:
    reduced = rows.copy()
    free = np.ones(reduced.shape[1], dtype=bool)
    for row in range(len(reduced)):
        column = int(np.argmax(np.where(free, np.abs(reduced[row]), -1.0)))
        free[column] = False
        reduced[row] /= reduced[row, column]
        others = np.arange(len(reduced)) != row
        reduced[others] -= np.outer(reduced[others, column], reduced[row])
    return reduced


def _combined(row: Array, other: Array) -> Iterator[Array]:
    """A row as it is, then with each of its entries cancelled by the other row."""
    yield row.copy()
    for column in np.flatnonzero(_named(other)):
        yield row - row[column] / other[column] * other


def _named(row: Array) -> Mask:
    """Mask of parameters that have a share in a combination worth naming, (P,)."""
    return np.asarray(np.abs(row) >= SHARE_NAMED * np.abs(row).max())
