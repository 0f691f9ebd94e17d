"""Residual budget: what of the residuals known causes explain, and what nothing explains."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from campaigns.arrays import Array
from campaigns.estimation.estimators import Estimator
from campaigns.evaluation.model_errors import ModelErrors, PairErrors, ShotErrors

Explanation = Literal["instrument", "repeatability", "neither", "not known"]

INSTRUMENT_EXPLAINS = 1.5
"""Up to this ratio of residuals to stated uncertainty nothing else needs to be looked for."""


@dataclass(frozen=True, slots=True)
class ResidualBudget:
    """Residuals of what was fitted beside what is known to cause some, mm (1 σ)."""

    of: Literal["distance", "coordinate"]
    residual_mm: float
    """√(Σ r² / degrees of freedom)."""
    instrument_mm: float
    """What the tracker's stated uncertainty alone would leave."""
    repeatability_mm: float | None
    """What the robot's repeatability (with the tracker's noise in it) alone would leave."""
    chi: float
    """√(Σ (r/u)² / degrees of freedom): 1 where the instrument explains everything."""
    dof: int

    @property
    def unexplained_mm(self) -> float:
        """Remainder beyond the larger of the known causes."""
        known = max(self.instrument_mm, self.repeatability_mm or 0.0)
        return float(np.sqrt(max(self.residual_mm**2 - known**2, 0.0)))

    @property
    def explained_by(self) -> Explanation:
        """Cause that accounts for the residuals; not known where repeatability was not measured."""
        if self.chi <= INSTRUMENT_EXPLAINS:
            return "instrument"
        if self.repeatability_mm is None:
            return "not known"
        return "repeatability" if self.unexplained_mm == 0.0 else "neither"


def residual_budget(
    errors: ModelErrors,
    estimator: Estimator,
    dof: int,
    chi2: float | None,
    repeated_away_mm: Array | None,
) -> ResidualBudget | None:
    """Budget of what was fitted; points (N, 3) are about the mean of repeated visits.

    None without degrees of freedom.
    """
    repeated_mm = None if repeated_away_mm is None else _per_axis(repeated_away_mm)
    if dof < 1:
        return None
    if estimator is Estimator.POINTS:
        return _of_coordinates(errors.shots, dof, chi2, repeated_mm)
    return _of_distances(errors.fitted, dof, repeated_mm)


def _of_distances(
    fitted: PairErrors | None, dof: int, repeated_mm: float | None
) -> ResidualBudget | None:
    if fitted is None or fitted.after_mm is None:
        return None
    after = fitted.after_mm
    return ResidualBudget(
        "distance",
        float(np.sqrt(after @ after / dof)),
        float(np.sqrt(np.mean(fitted.instrument_mm**2))),
        None if repeated_mm is None else float(np.sqrt(2.0)) * repeated_mm,
        float(np.sqrt(np.sum((after / fitted.instrument_mm) ** 2) / dof)),
        dof,
    )


def _of_coordinates(
    shots: ShotErrors | None, dof: int, chi2: float | None, repeated_mm: float | None
) -> ResidualBudget | None:
    if shots is None or chi2 is None:
        return None
    return ResidualBudget(
        "coordinate",
        float(np.sqrt(np.sum(shots.after_mm**2) / dof)),
        float(np.sqrt(np.mean(shots.instrument_mm**2))),
        repeated_mm,
        float(np.sqrt(chi2 / dof)),
        dof,
    )


def _per_axis(away_mm: Array) -> float:
    """Standard deviation of one coordinate of points (N, 3) about their mean."""
    return float(np.sqrt(np.sum(away_mm**2) / (3 * (len(away_mm) - 1))))
