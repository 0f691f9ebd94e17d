"""What an identification is asked for, and what it gives."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from campaigns.estimators import Estimator, Outliers
from campaigns.identification.knowledge import Knowledge
from campaigns.numerics.estimate import Noise
from campaigns.numerics.frames import Transform
from campaigns.numerics.geometry import Array
from campaigns.numerics.instrument import TrackerUncertainty
from campaigns.numerics.robust import Loss
from campaigns.numerics.statistics import Spread, correlations, spread

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
    knowledge: Knowledge = field(default_factory=Knowledge)
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
class Misfit:
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
    misfit: Misfit | None = None

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
class Identification:
    """What was found, how well it is known, and whether it may be used."""

    request: IdentificationRequest
    converged: bool
    explanation: str
    iterations: int
    rank: int
    condition: float
    noise: Noise
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
