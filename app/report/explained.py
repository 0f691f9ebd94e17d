"""How the parameters hang together, and what of the residuals nothing explains."""

from dataclasses import dataclass

import numpy as np

from app.report.evidence import MeasuredSeries
from app.report.findings import IdentificationFinding
from app.report.model_errors import PairErrors, excluded_rows, usable_pairs
from campaigns.dataset import Dataset
from campaigns.numerics.forward import forward
from campaigns.numerics.frames import fit_transform
from campaigns.numerics.geometry import Array, Geometry, Index, indices
from campaigns.numerics.instrument import TrackerUncertainty
from campaigns.numerics.par4 import NoAssembly
from campaigns.numerics.residuals import DistanceResiduals, PointResiduals, PositionModel
from campaigns.numerics.statistics import correlations, covariance
from campaigns.shot_sets import ShotSet
from campaigns.validation_traces import stated_covariance_mm2


@dataclass(frozen=True, slots=True)
class Correlation:
    """How two parameters' errors go together, from -1 to 1."""

    first: str
    second: str
    value: float


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
class Remainder:
    """The residuals of the fitted distances beside what is known to cause some, mm (1 σ)."""

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


def remainder(
    fitted: PairErrors, finding: IdentificationFinding, repeated_away_mm: Array | None
) -> Remainder | None:
    """From the fitted pairs, and points (N, 3) about the mean of repeated visits.

    None without degrees of freedom.
    """
    after, dof = fitted.after_mm, len(fitted.pairs) - finding.rank
    if after is None or dof < 1:
        return None
    return Remainder(
        float(np.sqrt(after @ after / dof)),
        float(np.sqrt(np.mean(fitted.instrument_mm**2))),
        None if repeated_away_mm is None else float(np.sqrt(2.0)) * _per_axis(repeated_away_mm),
        float(np.sqrt(np.sum((after / fitted.instrument_mm) ** 2) / dof)),
        dof,
    )


def correlations_of(
    measured: MeasuredSeries, finding: IdentificationFinding, instrument: TrackerUncertainty
) -> Correlations | None:
    """From the estimator's Jacobian at its answer; None where the data cannot tell them."""
    data, names = measured.data, finding.free
    geometry = Geometry.from_flat(finding.identified_flat())
    usable = ~excluded_rows(data, finding.excluded) & forward(geometry, data.joints_rad).found
    rows = usable_pairs(data, ShotSet.IDENTIFICATION, usable).ravel()
    model = PositionModel(geometry, indices(names), data.joints_rad[rows])
    try:
        if finding.estimator == "points":
            stated = stated_covariance_mm2(measured.shots, data.points_in_tracker_mm, instrument)
            jacobian = _jacobian_of_points(model, data.points_in_tracker_mm[rows], stated[rows])
        else:
            jacobian = _jacobian_of_distances(model, data, rows.reshape(-1, 2))
        matrix = correlations(covariance(jacobian))
    except (NoAssembly, ValueError, np.linalg.LinAlgError):
        return None
    return Correlations(names, matrix[: len(names), : len(names)])


def _jacobian_of_distances(model: PositionModel, data: Dataset, pairs: Index) -> Array:
    """Rows are pairs; the model's shots stand in the pairs' order."""
    first, second = np.arange(0, pairs.size, 2), np.arange(1, pairs.size, 2)
    measured = data.measured_distances_mm(pairs)
    return DistanceResiduals(model, first, second, measured).jacobian(model.nominal)


def _jacobian_of_points(model: PositionModel, points: Array, covariance_mm2: Array) -> Array:
    whitening = np.linalg.inv(np.linalg.cholesky(covariance_mm2))
    frame = fit_transform(model.positions_mm(model.nominal), points)
    x = np.concatenate([model.nominal, np.zeros(6)])
    return PointResiduals(model, points, whitening, frame).jacobian(x)


def _per_axis(away_mm: Array) -> float:
    """Standard deviation of one coordinate of points (N, 3) about their mean."""
    return float(np.sqrt(np.sum(away_mm**2) / (3 * (len(away_mm) - 1))))
