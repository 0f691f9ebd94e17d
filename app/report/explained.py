"""How the parameters hang together, and what of the residuals nothing explains."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from app.report.findings import IdentificationFinding
from app.report.model_errors import ModelErrors, PairErrors, ShotErrors
from campaigns.arrays import Array
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.observability import correlations
from campaigns.identification.result import Correlation


@dataclass(frozen=True, slots=True, eq=False)
class Correlations:
    """Of the identified parameters: the whole matrix (P, P), and its names."""

    names: tuple[str, ...]
    matrix: Array

    def strongest(self, count: int) -> tuple[Correlation, ...]:
        """The pairs of parameters with the largest |ρ|, strongest first."""
        first, second = np.triu_indices(len(self.names), k=1)
        order = np.argsort(-np.abs(self.matrix[first, second]), kind="stable")[:count]
        return tuple(
            Correlation(
                self.names[first[k]], self.names[second[k]], self._between(first[k], second[k])
            )
            for k in order.tolist()
        )

    def _between(self, row: int, column: int) -> float:
        return float(self.matrix[row, column])


@dataclass(frozen=True, slots=True)
class ResidualBudget:
    """The residuals of what was fitted beside what is known to cause some, mm (1 σ)."""

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
        """What is left beyond the larger of the known causes."""
        known = max(self.instrument_mm, self.repeatability_mm or 0.0)
        return float(np.sqrt(max(self.residual_mm**2 - known**2, 0.0)))


def residual_budget(
    errors: ModelErrors, finding: IdentificationFinding, repeated_away_mm: Array | None
) -> ResidualBudget | None:
    """From what was fitted, and points (N, 3) about the mean of repeated visits.

    None without degrees of freedom.
    """
    repeated_mm = None if repeated_away_mm is None else _per_axis(repeated_away_mm)
    if finding.estimator == Estimator.POINTS:
        return _of_coordinates(errors.shots, finding, repeated_mm)
    return _of_distances(errors.fitted, finding, repeated_mm)


def correlations_of(finding: IdentificationFinding) -> Correlations | None:
    """Those of the parameters whose σ are known; None where there are none."""
    known = finding.covariance
    if known is None or not known.names:
        return None
    return Correlations(known.names, correlations(np.array(known.matrix)))


def _of_distances(
    fitted: PairErrors | None, finding: IdentificationFinding, repeated_mm: float | None
) -> ResidualBudget | None:
    if fitted is None or fitted.after_mm is None or finding.dof < 1:
        return None
    after, dof = fitted.after_mm, finding.dof
    return ResidualBudget(
        "distance",
        float(np.sqrt(after @ after / dof)),
        float(np.sqrt(np.mean(fitted.instrument_mm**2))),
        None if repeated_mm is None else float(np.sqrt(2.0)) * repeated_mm,
        float(np.sqrt(np.sum((after / fitted.instrument_mm) ** 2) / dof)),
        dof,
    )


def _of_coordinates(
    shots: ShotErrors | None, finding: IdentificationFinding, repeated_mm: float | None
) -> ResidualBudget | None:
    if shots is None or finding.chi2 is None or finding.dof < 1:
        return None
    return ResidualBudget(
        "coordinate",
        float(np.sqrt(np.sum(shots.after_mm**2) / finding.dof)),
        float(np.sqrt(np.mean(shots.instrument_mm**2))),
        repeated_mm,
        float(np.sqrt(finding.chi2.value / finding.dof)),
        finding.dof,
    )


def _per_axis(away_mm: Array) -> float:
    """Standard deviation of one coordinate of points (N, 3) about their mean."""
    return float(np.sqrt(np.sum(away_mm**2) / (3 * (len(away_mm) - 1))))
