"""What a study shows: how large errors are, and whether stated standard deviations are honest."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri, stdtrit

from campaigns.errors import ShotsMissing
from campaigns.numerics.geometry import Array
from campaigns.study import CampaignOutcome, Estimate, StudySetup

CONFIDENCE = 0.95
LEAST_CAMPAIGNS = 2
QUANTILES = (0.5, 0.95)


@dataclass(frozen=True, slots=True)
class ParameterSummary:
    """Over all campaigns, in file units (mm or deg)."""

    name: str
    bias: float
    """Mean error."""
    std: float
    """Standard deviation of the errors."""
    stated_std: float
    """Root mean square of the stated ones."""
    covered: float
    """Share of 95 % intervals that hold the true value."""

    @property
    def ratio(self) -> float:
        """Empirical over stated; 1 is honest."""
        return self.std / self.stated_std


@dataclass(frozen=True, slots=True)
class StudySummary:
    """Over all campaigns that ended with an estimate."""

    campaigns: int
    failed: int
    parameters: tuple[ParameterSummary, ...]
    unseen_mean_mm: tuple[float, ...] | None
    """Quantiles 0.5 and 0.95 over campaigns; None without unseen pairs."""
    unseen_max_mm: tuple[float, ...] | None


def summarise(setup: StudySetup, outcomes: Sequence[CampaignOutcome]) -> StudySummary:
    """Raises `ShotsMissing` when fewer than two campaigns ended with an estimate."""
    found = [outcome.estimate for outcome in outcomes if outcome.estimate is not None]
    if len(found) < LEAST_CAMPAIGNS:
        reasons = {outcome.failure for outcome in outcomes if outcome.failure}
        raise ShotsMissing(
            f"{len(found)} of {len(outcomes)} campaigns could be identified",
            remedy=f"ask for more campaigns, or look into: {'; '.join(sorted(reasons)) or '-'}",
        )
    return StudySummary(
        len(found),
        len(outcomes) - len(found),
        _parameters(setup, found),
        _quantiles(np.array([estimate.unseen_mean_mm for estimate in found])),
        _quantiles(np.array([estimate.unseen_max_mm for estimate in found])),
    )


def interval_factor(setup: StudySetup) -> float:
    """Half-width of a 95 % interval in stated standard deviations.

    Student's where the variance is the residuals' own, normal where the tracker's is known.
    """
    tail = 0.5 * (1.0 + CONFIDENCE)
    if setup.estimator == "distances":
        return float(stdtrit(len(setup.fitted.pairs) - len(setup.free), tail))
    return float(ndtri(tail))


def _parameters(setup: StudySetup, found: Sequence[Estimate]) -> tuple[ParameterSummary, ...]:
    errors = np.array([estimate.errors for estimate in found])
    stated = np.array([estimate.std for estimate in found])
    covered = (np.abs(errors) <= interval_factor(setup) * stated).mean(axis=0)
    columns = np.column_stack(
        [
            errors.mean(axis=0),
            errors.std(axis=0, ddof=1),
            np.sqrt(np.mean(stated**2, axis=0)),
            covered,
        ]
    )
    return tuple(
        ParameterSummary(name, *row) for name, row in zip(setup.free, columns.tolist(), strict=True)
    )


def _quantiles(values: Array) -> tuple[float, ...] | None:
    if np.isnan(values).any():
        return None
    return tuple(np.quantile(values, QUANTILES).tolist())
