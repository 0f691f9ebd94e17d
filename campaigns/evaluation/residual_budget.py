"""Residual budget: what of the residuals known causes explain, and what nothing explains."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from campaigns.estimation.estimators import Estimator
from campaigns.evaluation.model_errors import ModelErrors

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
    repeated_mm: float | None,
) -> ResidualBudget | None:
    """Budget of what was fitted; `repeated_mm`: one coordinate's scatter in repeated visits.

    None without degrees of freedom.
    """
    of_points = estimator is Estimator.POINTS
    left = errors.shots if of_points else errors.fitted
    if dof < 1 or left is None or left.after_mm is None:
        return None
    after, instrument = left.after_mm, left.instrument_mm
    if not of_points:
        chi2 = float(np.sum((after / instrument) ** 2))
        repeated_mm = None if repeated_mm is None else float(np.sqrt(2.0)) * repeated_mm
    if chi2 is None:
        return None
    return ResidualBudget(
        "coordinate" if of_points else "distance",
        float(np.sqrt(np.sum(after**2) / dof)),
        float(np.sqrt(np.mean(instrument**2))),
        repeated_mm,
        float(np.sqrt(chi2 / dof)),
        dof,
    )
