"""Distances between rows of points (N, 3); pairs are two arrays of rows, (M,) each."""

import numpy as np

from campaigns.numerics.geometry import Array, Index

TINY_MM = 1e-300
"""Keeps the direction between coincident points zero instead of undefined."""


def distances_mm(points_mm: Array, first: Index, second: Index) -> Array:
    """(M,)."""
    return np.asarray(np.linalg.norm(points_mm[second] - points_mm[first], axis=1))


def directions(points_mm: Array, first: Index, second: Index) -> Array:
    """Unit vectors from the first points to the second, (M, 3); zero where the two coincide."""
    between = points_mm[second] - points_mm[first]
    length = np.linalg.norm(between, axis=1, keepdims=True)
    return np.asarray(between / np.maximum(length, TINY_MM))
