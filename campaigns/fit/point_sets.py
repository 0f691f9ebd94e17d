"""Distances between rows of points (N, 3); pairs are two arrays of rows, (M,) each."""

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.fit.rigid_transforms import Transform, fit_transform

SHOTS_FOR_A_FRAME = 4
"""Fewest points whose best frame is relied on; three fix one exactly."""
TINY_MM = 1e-300
"""Keeps the direction between coincident points zero instead of undefined."""


def distances_mm(points_mm: Array, first: Index, second: Index) -> Array:
    """Return the distances of pairs, (M,); of stacks of points (…, N, 3), (…, M)."""
    between = points_mm[..., second, :] - points_mm[..., first, :]
    return np.asarray(np.linalg.norm(between, axis=-1))


def directions(points_mm: Array, first: Index, second: Index) -> Array:
    """Return unit vectors from the first points to the second, (M, 3); zero if the two coincide.

    Of stacks of points (…, N, 3), (…, M, 3).
    """
    between = points_mm[..., second, :] - points_mm[..., first, :]
    length = np.linalg.norm(between, axis=-1, keepdims=True)
    return np.asarray(between / np.maximum(length, TINY_MM))


def away_from_mean(points_mm: Array) -> Array:
    """Return the vectors from the mean of the points to each of them, (N, 3)."""
    return np.asarray(points_mm - points_mm.mean(axis=0))


def away_from_best_line(points_mm: Array) -> Array:
    """Return the vectors from the best straight line in space, square to it, to points (N, 3)."""
    centred = away_from_mean(points_mm)
    direction = np.linalg.svd(centred)[2][0]
    return np.asarray(centred - np.outer(centred @ direction, direction))


def farthest_apart(points_mm: Array) -> tuple[int, int]:
    """Return the rows of the two points between which the distance is largest."""
    distances = np.linalg.norm(points_mm[:, None] - points_mm[None], axis=2)
    first, second = np.unravel_index(int(np.argmax(distances)), distances.shape)
    return int(first), int(second)


def fitted_frame(from_mm: Array, to_mm: Array) -> Transform | None:
    """Return the rigid transform that brings points best to others (eqs. 22-25).

    Return None for points that do not fix one well: fewer than four, or all on a line.
    """
    if len(from_mm) < SHOTS_FOR_A_FRAME:
        return None
    try:
        return fit_transform(from_mm, to_mm)
    except ValueError:
        return None


def length_with_std(vector_mm: Array, covariance_mm2: Array) -> tuple[float, float]:
    """Return the length of a vector (3,) and its 1 σ, by its covariance (3, 3).

    A length of 0 has the σ of its worst direction.
    """
    length = float(np.linalg.norm(vector_mm))
    if length == 0.0:
        return 0.0, float(np.sqrt(np.linalg.eigvalsh(covariance_mm2)[-1]))
    along = vector_mm / length
    return length, float(np.sqrt(along @ covariance_mm2 @ along))
