"""Summaries of errors: how large a set of them is."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array
from campaigns.evaluation.decision import Requirement, decide, decide_all
from campaigns.evaluation.measured_lengths import MeasuredLength, largest_of, unsigned_excess_mm

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


def distance_requirements(
    errors_mm: Array, covariance_mm2: Array, limits_mm: Mapping[str, float], dof: float = math.inf
) -> tuple[Requirement, ...]:
    """Return a requirement for each limit, "mean" and "max", of errors of distances (M,).

    `covariance_mm2` is that of the errors, (M, M): parameters and points that pairs have in common
    included. `dof` are its degrees of freedom.
    """
    # The mean of |e| changes with each error by ± 1/M, and the sign of a small error is not known:
    # by the absolute covariances its variance holds for any signs. Noise also enlarges the sizes of
    # small errors, which averaging does not reduce.
    size_mm, std_mm, count = np.abs(errors_mm), np.sqrt(np.diag(covariance_mm2)), len(errors_mm)
    of_mean_mm = math.sqrt(float(np.abs(covariance_mm2).sum())) / count
    of_mean_mm = math.hypot(of_mean_mm, unsigned_excess_mm(errors_mm, std_mm))
    figures = {
        "mean": MeasuredLength(float(size_mm.mean()), 0.0, of_mean_mm, dof),
        "max": largest_of(size_mm, np.zeros(count), std_mm, dof, count),
    }
    return tuple(
        figures[name].requirement(f"{name} error", limit) for name, limit in limits_mm.items()
    )


def limits_met(after: Spread, limits_mm: Mapping[str, float]) -> bool:
    """Return whether there are acceptance limits of distances and all of them are met.

    Sizes alone carry no covariance, so U is not in it: `distance_requirements` decides with U.
    """
    sizes_mm = {"mean": after.mean_abs, "max": after.max_abs}
    decisions = [decide(sizes_mm[name], 0.0, limit) for name, limit in limits_mm.items()]
    return decide_all(decisions) == "pass"
