"""Many seeds in three numbers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

LOW, HIGH = 5.0, 95.0
"""Percentiles between which the spread is told."""


@dataclass(frozen=True, slots=True)
class Distribution:
    """Median of n values, and the percentiles `LOW` and `HIGH`."""

    n: int
    median: float
    low: float
    high: float


def distribution(values: Sequence[float]) -> Distribution:
    """Summarise values; raises `ValueError` for none."""
    if not len(values):
        raise ValueError("no values to summarise")
    low, median, high = np.percentile(values, (LOW, 50.0, HIGH)).tolist()
    return Distribution(len(values), median, low, high)


def middle(values: Sequence[float]) -> int:
    """The place of the value nearest to the median, the first of several."""
    return int(np.argmin(np.abs(np.asarray(values) - np.median(values))))
