"""Rigid pieces of measured shots: fits of modelled positions to points, of all shots or of pieces.

A tracker that was moved leaves shots of which every piece fits the robot by a rigid motion of its
own. Sums over the first shots give the best fit of any piece at once (moments), so the borders are
found in little more than the time of one look at each shot:

1. Where a piece does not fit, it is split where the squares of both parts add up to the least.
2. Every border is set again between its neighbours; pieces that fit together become one.
3. A border counts only if most shots of the smaller piece are off in the frame of the larger one: a
   single wrong point makes no station.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.evaluation.decision import COVERAGE
from campaigns.fit.rigid_transforms import (
    SHOTS_FOR_A_FRAME,
    away_from_mean,
    best_rotation,
    fitted_frame,
)

FEWEST_SHOTS = SHOTS_FOR_A_FRAME + 1
"""Shots below which a frame explains nearly everything."""
JUDGED_SHARE = 0.8
"""Share of the shots by which a fit is judged, so that a few gross errors do not decide."""
TRIMMING_ROUNDS = 5
"""Rounds of trimming: most settle in fewer, and those of wrong readings may turn in circles."""


def spread_mm(points: Array) -> float:
    """Return the root mean square of the distances of points (N, 3) from their middle."""
    return float(np.sqrt(np.mean(np.sum(away_from_mean(points) ** 2, axis=1))))


def similarity_fit(modelled: Array, measured: Array, *, scaled: bool = True) -> tuple[float, float]:
    """Return the scale of the best similarity with the greater part of the points, and its misfit.

    The misfit is the root mean square residual in parts of the points' spread.
    """
    rows = greater_part(modelled, measured, scaled=scaled)
    scale, residuals = similarity(modelled, measured, rows, scaled=scaled)
    size = float(np.linalg.norm(away_from_mean(measured[rows])))
    return scale, float(np.linalg.norm(residuals[rows])) / size if size > 0.0 else math.inf


def greater_part(modelled: Array, measured: Array, *, scaled: bool) -> Index:
    """Return the rows that fit best together, without the worst ones (trimmed least squares)."""
    # Fit, keep the rows with the smallest residuals, fit again to these: each round can only lower
    # the trimmed sum of squares. Rows that were left out may come back.
    rows = np.arange(len(modelled))
    keep = max(FEWEST_SHOTS - 1, int(JUDGED_SHARE * len(modelled)))
    for _ in range(TRIMMING_ROUNDS):
        _, residuals = similarity(modelled, measured, rows, scaled=scaled)
        rows = np.sort(np.argsort(np.linalg.norm(residuals, axis=1), kind="stable")[:keep])
    return rows


def similarity(
    modelled: Array, measured: Array, rows: Index, *, scaled: bool
) -> tuple[float, Array]:
    """Return the scale of the best similarity of some rows (Umeyama 1991), and all residuals."""
    a, b = (points - points[rows].mean(axis=0) for points in (modelled, measured))
    rotation, spread = best_rotation(a[rows], b[rows])
    size = float(np.sum(a[rows] ** 2))
    scale = float(np.sum(spread)) / size if scaled and size > 0.0 else 1.0
    scale = max(scale, np.finfo(np.float64).tiny)  # its logarithm is taken
    return scale, np.asarray(b - scale * a @ rotation.T)


def rigid_pieces(
    positions: Array, points: Array, limit_mm: float, worst_mm: float = math.inf
) -> list[int]:
    """Return the first rows of the pieces of positions and points (N, 3) that are rigid.

    Each piece fits within a root mean square of `limit_mm`, and each of its points within
    `worst_mm`. Return no rows where there are no such pieces of five shots or more.
    """
    pieces = _Pieces(positions, points, limit_mm, worst_mm)
    borders = [0, len(points)]
    while wrong := [piece for piece in pairwise(borders) if not pieces.fit(*piece)]:
        first, end = wrong[0]
        if end - first < 2 * FEWEST_SHOTS:
            return []
        borders = sorted([*borders, pieces.border(first, end)])
    before: list[int] = []
    while borders != before:
        before = [*borders]
        for place in range(1, len(borders) - 1):
            borders[place] = pieces.border(borders[place - 1], borders[place + 1])
        for first, border, end in zip(before, before[1:], before[2:], strict=False):
            if before == borders and pieces.fit(first, end):
                borders.remove(border)
                break
    triples = zip(borders, borders[1:], borders[2:], strict=False)
    is_explained = all(pieces.fit(*piece) for piece in pairwise(borders))
    is_better = COVERAGE * pieces.remain_mm(borders) <= pieces.remain_mm([0, len(points)])
    are_apart = all(pieces.are_apart(*triple) for triple in triples)
    return borders[:-1] if is_explained and is_better and are_apart else []


@dataclass(frozen=True, slots=True, eq=False)
class _Pieces:
    """Positions of a model and the points (N, 3) measured there, of which any piece is fitted."""

    positions: Array
    points: Array
    limit_mm: float
    worst_mm: float

    def fit(self, first: int, end: int) -> bool:
        """Return whether the rows from `first` up to `end` are rigid."""
        off_mm = np.linalg.norm(self._residuals(first, end), axis=1)
        return bool(np.sqrt(np.mean(off_mm**2)) <= self.limit_mm and off_mm.max() <= self.worst_mm)

    def border(self, first: int, end: int) -> int:
        """Return the row at which a piece falls best into two of five shots or more."""
        a, b = (away_from_mean(each[first:end]) for each in (self.positions, self.points))
        count = len(a)
        borders = np.arange(FEWEST_SHOTS, count - FEWEST_SHOTS + 1)
        products = np.einsum("ni,nj->nij", b, a).reshape(-1, 9)
        squares = np.sum(a**2 + b**2, axis=1, keepdims=True)
        sums = np.cumsum(np.hstack([a, b, products, squares]), axis=0)
        left_out = _squares(sums[borders - 1], borders)
        left_out = left_out + _squares(sums[-1] - sums[borders - 1], count - borders)
        return first + int(borders[np.argmin(left_out)])

    def remain_mm(self, borders: Sequence[int]) -> float:
        """Return the root mean square residual of the pieces between borders."""
        residuals = [self._residuals(*piece) for piece in pairwise(borders)]
        return float(np.sqrt(np.mean(np.sum(np.concatenate(residuals) ** 2, axis=1))))

    def are_apart(self, first: int, border: int, end: int) -> bool:
        """Return whether most shots of the smaller of two pieces are off in the larger's frame."""
        small, large = sorted(
            (slice(first, border), slice(border, end)), key=lambda piece: piece.stop - piece.start
        )
        frame = fitted_frame(self.positions[large], self.points[large])
        if frame is None:
            return False
        off_mm = np.linalg.norm(frame.apply(self.positions[small]) - self.points[small], axis=1)
        return bool(np.quantile(off_mm, 1.0 - JUDGED_SHARE) > self.limit_mm)

    def _residuals(self, first: int, end: int) -> Array:
        rows = np.arange(end - first)
        return similarity(self.positions[first:end], self.points[first:end], rows, scaled=False)[1]


# With a and b centred and the singular values s of Σ b a', the last negative for a reflection, the
# least squares of a rigid fit are Σ a² + Σ b² - 2 Σ s (Umeyama 1991).
def _squares(sums: Array, counts: Index) -> Array:
    """Return the least sums of squares (K,) of rigid fits, by moments (K, 16) of some shots."""
    a, b = sums[:, :3], sums[:, 3:6]
    cross = sums[:, 6:15].reshape(-1, 3, 3) - np.einsum("ki,kj->kij", b, a) / counts[:, None, None]
    spread = np.linalg.svd(cross, compute_uv=False)
    spread[:, 2] *= np.sign(np.linalg.det(cross))
    total = sums[:, 15] - np.sum(a**2 + b**2, axis=1) / counts
    return np.asarray(total - 2.0 * spread.sum(axis=1))
