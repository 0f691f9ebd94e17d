"""Patterns among the shots that were left out: a series in time, or a region of the workspace.

Single mistakes lie anywhere. Shots left out one after another have a cause in time, such as a
reflector that stood on its nest; shots left out near each other lie where the model fails. Both are
tested by permutation: how often would as many shots, drawn at random, lie so close? Time is asked
first, since a tour visits near poses one after another.
"""

from typing import Literal

import numpy as np

from campaigns.arrays import Array, Index, Mask

LEVEL = 0.01
"""Probability of as close a pattern by chance below which it has a cause."""
DRAWS = 999
"""Random sets of shots with which the pattern is compared."""


def pattern_of(
    kept: Mask, positions: Array, rng: np.random.Generator
) -> Literal["series", "region"] | None:
    """Return the pattern of the shots that are not `kept` (N,), in the order of time.

    `positions` (N, 3) are the shots' places. One shot has no pattern.
    """
    rows = np.flatnonzero(~kept)
    if len(rows) < 2:
        return None
    drawn = np.stack([rng.permutation(len(kept))[: len(rows)] for _ in range(DRAWS)])
    if _p_of(_closeness_in_time(rows), [_closeness_in_time(np.sort(draw)) for draw in drawn]):
        return "series"
    distance = np.linalg.norm(positions[:, None] - positions[None], axis=2)
    nearest, mean = _nearness(rows, distance)
    of_draws = np.array([_nearness(draw, distance) for draw in drawn])
    is_close = _p_of(nearest, of_draws[:, 0]) or _p_of(mean, of_draws[:, 1])
    return "region" if is_close else None


def _p_of(value: float, of_draws: list[float] | Array) -> bool:
    """Return whether fewer than 1 % of random values are as large or larger."""
    larger = int((np.asarray(of_draws) >= value - 1e-12).sum())
    return (larger + 1) / (len(of_draws) + 1) < LEVEL


# Scan statistic: a span of m shots that holds k of those left out is the more surprising the larger
# k log(k / m) is, for spans that begin and end with one of them.
def _closeness_in_time(rows: Index) -> float:
    """Return how close the closest of these rows stand, (k,) in ascending order."""
    first, last = np.triu_indices(len(rows), 1)
    held, span = last - first + 1, rows[last] - rows[first] + 1
    return float((held * np.log(held / span) + held).max())


def _nearness(rows: Index, distance: Array) -> tuple[float, float]:
    """Return the negative mean distance to the nearest other row, and to all others."""
    among = distance[np.ix_(rows, rows)]
    alone = among + np.diag(np.full(len(rows), np.inf))
    count = len(rows)
    return -float(alone.min(axis=1).mean()), -float(among.sum() / (count * (count - 1)))
