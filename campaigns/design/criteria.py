"""Criteria of optimal design, each a number of a set of shots to be made small."""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from campaigns.arrays import Array
from campaigns.design.candidates import Candidates

SHARPNESS = 4
"""The power of a variance by which E-optimality looks at its direction."""

CriterionName = Literal["I", "D", "A", "E"]


class Criterion(Protocol):
    """Criterion that compares designs; covariances (P, P) are of scaled unknowns."""

    def value(self, covariance: Array) -> float:
        """Value that shall be small."""
        ...

    def weight(self, covariance: Array) -> Array:
        """W such that near this covariance the value falls as tr(C W) falls, (P, P)."""
        ...

    def improvement(self, predicted_covariance: Array, sensitivity: Array) -> Array:
        """Improvement by adding each candidate, (M,), the more the better.

        `predicted_covariance` and `sensitivity`, (k, k, M), are J C Jᵀ and J C W C Jᵀ of each
        candidate's Jacobian J.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class TraceCriterion:
    """tr(C W) with a fixed W: I-optimality and A-optimality."""

    fixed: Array
    """W, (P, P)."""

    def value(self, covariance: Array) -> float:
        """The mean square of what W weighs."""
        return float(np.sum(covariance * self.fixed))

    def weight(self, covariance: Array) -> Array:  # noqa: ARG002 - the same whatever is known
        """W."""
        return self.fixed

    def improvement(self, predicted_covariance: Array, sensitivity: Array) -> Array:
        """Fall of the trace with each candidate, (M,)."""
        return trace_improvement(predicted_covariance, sensitivity)


@dataclass(frozen=True, slots=True, eq=False)
class MaxEigenvalue:
    """Largest eigenvalue of the parameters' covariance: E-optimality."""

    parameters: int

    def value(self, covariance: Array) -> float:
        """The variance of what is known worst."""
        return float(np.linalg.eigvalsh(self._own(covariance))[-1])

    def weight(self, covariance: Array) -> Array:
        """Σ vᵢ vᵢᵀ λᵢ⁴ / λ₁⁴ over the eigenvectors: what is known worst, and what is next to it.

        The worst one alone would be a poor guide: it changes from one exchange to the next.
        """
        values, vectors = np.linalg.eigh(self._own(covariance))
        weight = np.zeros_like(covariance)
        own = (vectors * (values / values[-1]) ** SHARPNESS) @ vectors.T
        weight[: self.parameters, : self.parameters] = own
        return weight

    def improvement(self, predicted_covariance: Array, sensitivity: Array) -> Array:
        """Fall of the weighted variances with each candidate, (M,)."""
        return trace_improvement(predicted_covariance, sensitivity)

    def _own(self, covariance: Array) -> Array:
        return covariance[: self.parameters, : self.parameters]


@dataclass(frozen=True, slots=True, eq=False)
class LogDet:
    """det C of all unknowns, a frame's included: D-optimality."""

    def value(self, covariance: Array) -> float:
        """The geometric mean of the variances along the confidence ellipsoid's axes."""
        return float(np.exp(np.linalg.slogdet(covariance).logabsdet / len(covariance)))

    def weight(self, covariance: Array) -> Array:
        """Zeros (P, P): the improvements are exact without a weight."""
        return np.zeros_like(covariance)

    def improvement(self, predicted_covariance: Array, sensitivity: Array) -> Array:  # noqa: ARG002 - as `weight` says
        """Fall of log det C with each candidate, (M,)."""
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


def trace_improvement(predicted_covariance: Array, sensitivity: Array) -> Array:
    """tr((1 + S)⁻¹ G) for each candidate, (M,)."""
    inverse, _ = inverse_of_one_plus(predicted_covariance)
    return np.asarray(np.einsum("abm,bam->m", inverse, sensitivity))


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
