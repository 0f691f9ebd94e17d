"""What an identification is asked for, and what it gives."""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from typing import Literal

import numpy as np
from pydantic import JsonValue

from campaigns.arrays import Array
from campaigns.estimation.estimate import ChiSquareTest
from campaigns.estimation.estimators import Estimator, Outliers
from campaigns.estimation.observability import Spread, correlations, spread
from campaigns.estimation.rigid_transforms import Transform, paper_angles_rad
from campaigns.estimation.robust import Loss
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.identification.parameter_selection import ParameterSelection

Verdict = Literal["pass", "fail", "not decided"]
Combination = tuple[str, ...]
"""Parameters that move together without any effect on what was measured."""

STRONG = 0.9
"""Correlations from here on are worth being told."""
STRONGEST = 20


@dataclass(frozen=True, slots=True, eq=False)
class IdentificationRequest:
    """How the shots are to be understood."""

    estimator: Estimator = Estimator.POINTS
    knowledge: ParameterSelection = field(default_factory=ParameterSelection)
    loss: Loss = field(default_factory=Loss)
    outliers: Outliers = Outliers.EXCLUDE
    instrument: TrackerUncertainty = field(default_factory=TrackerUncertainty)
    """Of shots of which the tracker stated nothing."""
    workspace: Array | None = None
    """Poses (N, 4) at which the position's uncertainty is asked for."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter before and after, in file units (mm or deg); `std` is None when unknown."""

    name: str
    nominal: float
    value: float
    std: float | None
    free: bool

    @property
    def delta(self) -> float:
        """Identified minus nominal."""
        return self.value - self.nominal


@dataclass(frozen=True, slots=True)
class BeforeAfter:
    """Errors in mm with the nominal and with the identified geometry."""

    before: Spread
    after: Spread


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Modelled minus measured, with either geometry: distances (N, 1) or positions (N, 3), mm."""

    before_mm: Array
    after_mm: Array

    def summary(self) -> BeforeAfter:
        """Of their sizes."""
        before, after = (np.linalg.norm(e, axis=1) for e in (self.before_mm, self.after_mm))
        return BeforeAfter(spread(before), spread(after))


@dataclass(frozen=True, slots=True)
class OutlierResidual:
    """How far an outlier is from where the others put it, and what would still be believed."""

    size_mm: float
    size_sigma: float
    limit_sigma: float


@dataclass(frozen=True, slots=True)
class Excluded:
    """A shot or a pair that was left out, and why; `misfit` only of an outlier."""

    reason: str
    shot: int | None = None
    pair: int | None = None
    misfit: OutlierResidual | None = None

    @property
    def what(self) -> str:
        """`shot 7` or `pair 3`."""
        return f"pair {self.pair}" if self.shot is None else f"shot {self.shot}"


@dataclass(frozen=True, slots=True)
class Correlation:
    """How two parameters' errors go together, from -1 to 1."""

    first: str
    second: str
    value: float


@dataclass(frozen=True, slots=True, eq=False)
class Covariance:
    """Of the identified parameters whose σ are known, in file units."""

    names: tuple[str, ...]
    matrix: Array
    """(K, K)"""

    def std(self) -> dict[str, float]:
        """1 σ by name."""
        return dict(zip(self.names, np.sqrt(np.diag(self.matrix)).tolist(), strict=True))

    def strong_correlations(self) -> tuple[Correlation, ...]:
        """Those of at least 0.9, the largest first, at most 20."""
        found = sorted(self._correlations(), key=lambda each: -abs(each.value))
        return tuple(each for each in found[:STRONGEST] if abs(each.value) >= STRONG)

    def _correlations(self) -> Iterator[Correlation]:
        matrix = correlations(self.matrix) if self.names else self.matrix
        for first, second in zip(*np.triu_indices(len(self.names), k=1), strict=True):
            yield Correlation(self.names[first], self.names[second], float(matrix[first, second]))


@dataclass(frozen=True, slots=True)
class PositionStd:
    """Root of the summed variances of X, Y and Z over the workspace, mm."""

    mean: float
    max: float


@dataclass(frozen=True, slots=True)
class ComparedModel:
    """One of several models: its price, what it knows of unseen pairs, and what became of it."""

    name: str
    parameters: int
    bic: float | None
    """Schwarz's criterion; None where it could not be fitted."""
    unseen_rms_mm: float | None
    kept: bool
    outcome: str


@dataclass(frozen=True, slots=True, eq=False)
class IdentificationResult:
    """What was found, how well it is known, and whether it may be used."""

    request: IdentificationRequest
    converged: bool
    explanation: str
    iterations: int
    rank: int
    condition: float
    noise: ChiSquareTest
    noise_in_words: str
    parameters: tuple[Parameter, ...]
    covariance: Covariance
    position_std: PositionStd | None
    tracker_from_base: Transform | None
    """None where no frame was estimated."""
    fitted: Errors
    """Of the shots' positions or the pairs' distances that were kept."""
    unseen_pairs: Errors | None
    excluded: tuple[Excluded, ...]
    unobservable: tuple[Combination, ...]
    """Held at nominal, for neither shots nor priors tell them."""
    by_priors_alone: tuple[Combination, ...]
    verdict: Verdict
    reasons: tuple[str, ...]
    compared: tuple[ComparedModel, ...] = ()
    """The models that it was chosen from, the standard one first; empty without a choice."""

    @property
    def residuals(self) -> BeforeAfter:
        """How large the fitted errors are."""
        return self.fitted.summary()

    @property
    def unseen(self) -> BeforeAfter | None:
        """How large the errors of distances are that were never fitted."""
        return None if self.unseen_pairs is None else self.unseen_pairs.summary()

    @property
    def dof(self) -> int:
        """Degrees of freedom: measurements and priors, less what was found from them."""
        return self.noise.dof


SCHEMA = "pkmcal/identification/1"


@dataclass(frozen=True, slots=True)
class ParameterEntry:
    """One parameter, in mm or deg."""

    nominal: float
    value: float
    delta: float
    std: float | None
    free: bool


def identification_document(found: IdentificationResult, seconds: float) -> dict[str, JsonValue]:
    """The document; `seconds` is what the solution took."""
    return {
        "schema": SCHEMA,
        **_asked(found),
        "converged": found.converged,
        "iterations": found.iterations,
        "rank": found.rank,
        "condition": _finite(found.condition),
        "dof": found.dof,
        "parameters": _parameters(found),
        "residuals_mm": _before_after(found.residuals),
        "unseen_mm": None if found.unseen is None else _before_after(found.unseen),
        "excluded": [_excluded(left) for left in found.excluded],
        "unobservable": [list(names) for names in found.unobservable],
        "known_by_priors_alone": [list(names) for names in found.by_priors_alone],
        "models": [asdict(model) for model in found.compared],
        "chi2": _chi2(found.noise, found.noise_in_words),
        "covariance": _covariance(found.covariance),
        "correlations": _correlations(found.covariance),
        "position_std_mm": None if found.position_std is None else asdict(found.position_std),
        "frame": None if found.tracker_from_base is None else _frame(found.tracker_from_base),
        "verdict": found.verdict,
        "reasons": list(found.reasons),
        "seconds": seconds,
    }


def _asked(found: IdentificationResult) -> dict[str, JsonValue]:
    """What was asked for."""
    request = found.request
    return {
        "estimator": request.estimator.value,
        "loss": {"shape": request.loss.shape.value, "scale": request.loss.scale},
        "outliers": request.outliers.value,
        "priors": {prior.name: prior.std for prior in request.knowledge.priors},
    }


def _parameters(found: IdentificationResult) -> dict[str, JsonValue]:
    """By name, each as a `ParameterEntry`."""
    return {
        p.name: asdict(ParameterEntry(p.nominal, p.value, p.delta, p.std, p.free))
        for p in found.parameters
    }


def _before_after(errors: BeforeAfter) -> dict[str, JsonValue]:
    return {"before": asdict(errors.before), "after": asdict(errors.after)}


def _excluded(left: Excluded) -> dict[str, JsonValue]:
    """The shot or the pair; the sizes only of an outlier."""
    named: dict[str, JsonValue] = {"pair": left.pair} if left.shot is None else {"shot": left.shot}
    return named | {"reason": left.reason} | (asdict(left.misfit) if left.misfit else {})


def _chi2(noise: ChiSquareTest, in_words: str) -> dict[str, JsonValue]:
    return {
        "value": noise.chi2,
        "dof": noise.dof,
        "p": noise.p,
        "believable": noise.believable,
        "scale": noise.scale,
        "says": in_words,
    }


def _covariance(known: Covariance) -> dict[str, JsonValue]:
    return {"names": list(known.names), "matrix": known.matrix.tolist()}


def _correlations(known: Covariance) -> list[JsonValue]:
    return [
        {"a": each.first, "b": each.second, "value": each.value}
        for each in known.strong_correlations()
    ]


def _frame(tracker_from_base: Transform) -> dict[str, JsonValue]:
    """The translation, and the angles of the paper's eq. 23."""
    x_mm, y_mm, z_mm = tracker_from_base.translation_mm.tolist()
    phi, gamma, psi = np.degrees(paper_angles_rad(tracker_from_base)).tolist()
    return {
        "x_mm": x_mm,
        "y_mm": y_mm,
        "z_mm": z_mm,
        "phi_deg": phi,
        "gamma_deg": gamma,
        "psi_deg": psi,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
