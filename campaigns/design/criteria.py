"""Criteria of optimal design, each a number of a set of shots to be made small."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Literal

import numpy as np
from typing_extensions import override

from campaigns.arrays import Array
from campaigns.design.candidates import Candidates

SHARPNESS = 4
"""The power of a variance by which E-optimality looks at its direction."""

CriterionName = Literal["I", "D", "A", "E"]


class Criterion(ABC):
    """Criterion that compares designs; covariances (P, P) are of scaled unknowns."""

    @abstractmethod
    def value(self, covariance: Array) -> float:
        """Value that shall be small."""

    @abstractmethod
    def weight(self, covariance: Array) -> Array:
        """W such that near this covariance the value falls as tr(C W) falls, (P, P)."""

    def improvement(self, predicted_covariance: Array, sensitivity: Array) -> Array:
        """Improvement by adding each candidate, (M,), the more the better: the fall of tr(C W).

        `predicted_covariance` and `sensitivity`, (k, k, M), are J C Jᵀ and J C W C Jᵀ of each
        candidate's Jacobian J.
        """
        inverse, _ = inverse_of_one_plus(predicted_covariance)
        return np.asarray(np.einsum("abm,bam->m", inverse, sensitivity))


@dataclass(frozen=True, slots=True, eq=False)
class TraceCriterion(Criterion):
    """tr(C W) with a fixed W: I-optimality and A-optimality."""

    fixed: Array
    """W, (P, P)."""

    @override
    def value(self, covariance: Array) -> float:
        return float(np.sum(covariance * self.fixed))

    @override
    def weight(self, covariance: Array) -> Array:
        return self.fixed


@dataclass(frozen=True, slots=True, eq=False)
class MaxEigenvalue(Criterion):
    """Largest eigenvalue of the parameters' covariance: E-optimality, what is known worst."""

    parameters: int

    @override
    def value(self, covariance: Array) -> float:
        return float(np.linalg.eigvalsh(self._own(covariance))[-1])

    @override
    def weight(self, covariance: Array) -> Array:
        # Σ vᵢ vᵢᵀ λᵢ⁴ / λ₁⁴: the worst one alone would change from one exchange to the next
        values, vectors = np.linalg.eigh(self._own(covariance))
        weight = np.zeros_like(covariance)
        own = (vectors * (values / values[-1]) ** SHARPNESS) @ vectors.T
        weight[: self.parameters, : self.parameters] = own
        return weight

    def _own(self, covariance: Array) -> Array:
        return covariance[: self.parameters, : self.parameters]


@dataclass(frozen=True, slots=True, eq=False)
class LogDet(Criterion):
    """det C of all unknowns, a frame's included: D-optimality.

    Its value is the geometric mean of the variances along the confidence ellipsoid's axes.
    """

    @override
    def value(self, covariance: Array) -> float:
        return float(np.exp(np.linalg.slogdet(covariance).logabsdet / len(covariance)))

    @override
    def weight(self, covariance: Array) -> Array:
        return np.zeros_like(covariance)  # the improvements are exact without one

    @override
    def improvement(self, predicted_covariance: Array, sensitivity: Array) -> Array:
        return inverse_of_one_plus(predicted_covariance)[1]


def make_criterion(name: CriterionName, candidates: Candidates, workspace_rows: Array) -> Criterion:
    """I: least mean square error of position where `workspace_rows` (N, 3, P), mm and rad, look.

    A and E are of parameters in units of their mean sensitivity on a candidate, so that lengths and
    angles compare.
    """
    match name:
        case "I":
            rows = (workspace_rows / candidates.scale).reshape(-1, len(candidates.scale))
            return TraceCriterion(rows.T @ rows / len(workspace_rows))
        case "D":
            return LogDet()
        case "A":
            own = np.arange(len(candidates.scale)) < candidates.parameters
            return TraceCriterion(np.diag(own.astype(np.float64)))
        case "E":
            return MaxEigenvalue(candidates.parameters)


def inverse_of_one_plus(predicted_covariance: Array) -> tuple[Array, Array]:
    """(1 + S)⁻¹ (k, k, M) and log det(1 + S) (M,) of symmetric, not negative S (k, k, M).

    Gauss-Jordan on all candidates at once: for three rows ten times faster than a batched call.
    """
    matrix = predicted_covariance + np.eye(len(predicted_covariance))[:, :, None]
    logarithm = np.zeros(predicted_covariance.shape[2])
    for place in range(len(matrix)):
        pivot = matrix[place, place].copy()
        row, column = matrix[place] / pivot, matrix[:, place].copy()
        matrix -= column[:, None] * row
        matrix[place], matrix[:, place] = row, -column / pivot
        matrix[place, place] = 1.0 / pivot
        logarithm += np.log(pivot)
    return matrix, logarithm
