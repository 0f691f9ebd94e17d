"""How large a set of errors is, in the figures of the before/after table."""

from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array

PERCENT = 95.0


@dataclass(frozen=True, slots=True)
class ErrorSummary:
    """Of the absolute values of n errors, mm. σ is None for a single one."""

    n: int
    mean: float
    sigma: float | None
    max: float
    p95: float

    @property
    def mean_plus_3_sigma(self) -> float | None:
        """Mean and three standard deviations, as ISO 9283 forms RP."""
        return None if self.sigma is None else self.mean + 3.0 * self.sigma


def summary(errors_mm: Array) -> ErrorSummary:
    """Summarise errors (N,); raises `ValueError` for none."""
    if errors_mm.size == 0:
        raise ValueError("no errors to summarise")
    size = np.abs(errors_mm)
    sigma = float(size.std(ddof=1)) if size.size > 1 else None
    return ErrorSummary(
        int(size.size),
        float(size.mean()),
        sigma,
        float(size.max()),
        float(np.percentile(size, PERCENT)),
    )
