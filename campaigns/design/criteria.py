"""Criteria of optimal design, each a number of a set of shots to be made small."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from campaigns.arrays import Array
from campaigns.design.candidates import Candidates

SHARPNESS = 8
"""The power p of Kiefer's φ_p, (Σ λᵢ^p)^(1/p), by which the largest eigenvalue is looked for."""

CriterionName = Literal["I", "D", "A", "E"]


def _fall_of_trace(predicted_covariance: Array, sensitivity: Array) -> Array:
    inverse, _ = inverse_of_one_plus(predicted_covariance)
    return np.asarray(np.einsum("abm,bam->m", inverse, sensitivity))


@dataclass(frozen=True, slots=True, eq=False)
class Criterion:
    """Criterion that compares designs; covariances (P, P) are of scaled unknowns."""

    value: Callable[[Array], float]
    """Value of a covariance that shall be small."""
    weight: Callable[[Array], Array]
    """W such that near a covariance the value falls as tr(C W) falls, (P, P)."""
    improvement: Callable[[Array, Array], Array] = _fall_of_trace
    """Improvement by adding each candidate, (M,), the more the better: the fall of tr(C W).

    Of predicted covariances and sensitivities, (k, k, M): J C Jᵀ and J C W C Jᵀ of each
    candidate's Jacobian J.
    """


def make_criterion(name: CriterionName, candidates: Candidates, workspace_rows: Array) -> Criterion:
    """I: least mean square error of position where `workspace_rows` (N, 3, P), mm and rad, look.

    D: det C of all unknowns, a frame's included. A: sum of the parameters' variances. E: largest
    eigenvalue of the parameters' covariance, what is known worst. A and E are of parameters in
    units of their mean sensitivity on a candidate, so that lengths and angles compare.
    """
    match name:
        case "I":
            rows = (workspace_rows / candidates.scale).reshape(-1, len(candidates.scale))
            return _trace(rows.T @ rows / len(workspace_rows))
        case "D":
            # the improvements are exact without a weight
            return Criterion(_determinant, np.zeros_like, lambda s, _: inverse_of_one_plus(s)[1])
        case "A":
            own = np.arange(len(candidates.scale)) < candidates.parameters
            return _trace(np.diag(own.astype(np.float64)))
        case "E":
            return _largest_eigenvalue(slice(candidates.parameters))


def _trace(weight: Array) -> Criterion:
    """tr(C W) with a fixed W, (P, P)."""
    return Criterion(lambda covariance: float(np.sum(covariance * weight)), lambda _: weight)


def _determinant(covariance: Array) -> float:
    """Geometric mean of the variances along the confidence ellipsoid's axes."""
    return float(np.exp(np.linalg.slogdet(covariance).logabsdet / len(covariance)))


def _largest_eigenvalue(own: slice) -> Criterion:
    """Nearly the largest: that one alone is another one after few exchanges, which then get stuck.

    φ_p with Σ vᵢ vᵢᵀ (λᵢ / λ₁)^(p - 1), its gradient but for a factor.
    """

    def value(covariance: Array) -> float:
        values = np.linalg.eigvalsh(covariance[own, own])
        return float(values[-1] * np.linalg.norm(values / values[-1], SHARPNESS))

    def weight(covariance: Array) -> Array:
        values, vectors = np.linalg.eigh(covariance[own, own])
        found = np.zeros_like(covariance)
        found[own, own] = (vectors * (values / values[-1]) ** (SHARPNESS - 1)) @ vectors.T
        return found

    return Criterion(value, weight)


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
