"""Summaries of errors: how large a set of them is."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array

PERCENT = 95.0


@dataclass(frozen=True, slots=True)
class Spread:
    """Size of a set of errors, mm."""

    mean_abs: float
    rms: float
    max_abs: float


@dataclass(frozen=True, slots=True)
class BeforeAfter:
    """Sizes of errors with the nominal and with the identified kinematics."""

    before: Spread
    after: Spread

    @property
    def says(self) -> str:
        """Mean and largest error before and after, in words."""
        before, after = self.before, self.after
        return (
            f"mean {before.mean_abs:.3f} → {after.mean_abs:.3f} mm, "
            f"max {before.max_abs:.3f} → {after.max_abs:.3f} mm"
        )


@dataclass(frozen=True, slots=True)
class ErrorSummary:
    """Statistics of the absolute values of n errors, mm; σ is None for a single one."""

    n: int
    mean: float
    sigma: float | None
    max: float
    p95: float

    @property
    def mean_plus_3_sigma(self) -> float | None:
        """Mean and three standard deviations, as ISO 9283 forms RP."""
        return None if self.sigma is None else self.mean + 3.0 * self.sigma


def spread(errors_mm: Array) -> Spread:
    """Return the size of errors (N,) or of vectors (N, 3); raise `ValueError` without any."""
    size = _sizes(errors_mm)
    return Spread(float(size.mean()), float(np.sqrt(np.mean(size**2))), float(size.max()))


def summary(errors_mm: Array) -> ErrorSummary:
    """Return statistics of errors (N,), or of vectors (N, 3); raise `ValueError` without any."""
    size = _sizes(errors_mm)
    # σ of the absolute values, as ISO 9283 forms S: it is no σ of the signed errors.
    sigma = float(size.std(ddof=1)) if size.size > 1 else None
    return ErrorSummary(
        int(size.size),
        float(size.mean()),
        sigma,
        float(size.max()),
        float(np.percentile(size, PERCENT)),
    )


def _sizes(errors_mm: Array) -> Array:
    """Return absolute values of errors (N,), or lengths of vectors (N, 3)."""
    if errors_mm.size == 0:
        raise ValueError("no errors to summarise")
    return np.asarray(
        np.linalg.norm(errors_mm, axis=1) if errors_mm.ndim > 1 else np.abs(errors_mm)
    )


def limits_met(after: Spread, limits_mm: Mapping[str, float]) -> bool:
    """Return whether there are acceptance limits of distances and all of them are met."""
    reached = {"mean": after.mean_abs, "max": after.max_abs}
    return bool(limits_mm) and all(reached[name] <= limit for name, limit in limits_mm.items())
