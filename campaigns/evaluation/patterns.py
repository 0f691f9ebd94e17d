"""Patterns in errors: whether they follow a place, neighbours agree, or one stands out.

Each test gives what it measures and p, the share of patternless errors that show as much.
"""

import numpy as np
import scipy

from campaigns.arrays import Array

FEWEST = 5
"""Values from which on a pattern is looked for."""
MOST_NEIGHBOURS = 400
"""Places whose neighbours are looked for: all of many would take the square of them."""
MEDIAN_OF_THREE = 1.538172
"""Median length of a vector of three components of unit variance."""
Tested = tuple[float, float]
NOTHING: Tested = (0.0, 1.0)


def rank_trend(values: Array, sizes: Array) -> Tested:
    """Spearman's rank correlation of sizes (N,) with values (N,), and its p on both sides."""
    if len(values) < FEWEST or np.ptp(values) == 0.0 or np.ptp(sizes) == 0.0:
        return NOTHING
    rho = float(np.corrcoef(_ranks(values), _ranks(sizes))[0, 1])
    freedom = len(values) - 2
    t = abs(rho) * np.sqrt(freedom / max(1.0 - rho**2, 1e-12))
    return rho, float(2.0 * scipy.special.stdtr(freedom, -t))


def neighbours_agree(places: Array, vectors: Array) -> Tested:
    """Mean cosine between vectors (N, 3) of nearest places (N, 3), and p of one so large."""
    chosen = np.unique(np.linspace(0, len(places) - 1, MOST_NEIGHBOURS).astype(int))
    places, vectors = places[chosen], vectors[chosen]
    away = np.linalg.norm(places[:, None] - places, axis=2)
    np.fill_diagonal(away, np.inf)
    pairs = np.unique(
        np.sort(np.stack([np.arange(len(away)), away.argmin(axis=1)], axis=1)), axis=0
    )
    first, second = vectors[pairs.T]
    sizes = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    told = sizes > 0.0
    cosines = np.sum(first * second, axis=1)[told] / sizes[told]
    if len(cosines) < FEWEST or np.ptp(cosines) == 0.0:
        return NOTHING
    t = cosines.mean() / (cosines.std(ddof=1) / np.sqrt(len(cosines)))
    return float(cosines.mean()), float(scipy.special.stdtr(len(cosines) - 1, -t))


def centred(errors: Array) -> Tested:
    """Mean of errors (N,), and p of one so far from zero, by Student's test."""
    if len(errors) < FEWEST or np.ptp(errors) == 0.0:
        return float(errors.mean()) if len(errors) else 0.0, 1.0
    t = abs(errors.mean()) / (errors.std(ddof=1) / np.sqrt(len(errors)))
    return float(errors.mean()), float(2.0 * scipy.special.stdtr(len(errors) - 1, -t))


def stands_out(lengths: Array) -> Tested:
    """Largest length (N,) of errors in space by their median, and p of one so large.

    Errors are taken to scatter alike in all directions.
    """
    median = float(np.median(lengths))
    if len(lengths) < FEWEST or median == 0.0:
        return NOTHING
    ratio = float(lengths.max()) / median
    beyond = float(scipy.special.chdtrc(3.0, (MEDIAN_OF_THREE * ratio) ** 2))
    return ratio, float(-np.expm1(len(lengths) * np.log1p(-beyond)))


def share_from_middle(places: Array, row: int) -> float:
    """Share of places (N, 3) nearer to their middle than that of a row, in half extents."""
    half = np.maximum(0.5 * np.ptp(places, axis=0), 1e-9)
    away = np.linalg.norm((places - 0.5 * (places.min(axis=0) + places.max(axis=0))) / half, axis=1)
    return float(np.mean(away < away[row]))


def _ranks(values: Array) -> Array:
    """Ranks from 1, of equal values their mean."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(count) - 0.5 * (count - 1))[place])
