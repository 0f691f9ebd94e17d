"""Sizes of groups of unknowns and factors of parts of the noise, by one fixed point.

The noise of a shot is Σ φ_k V_k over its parts: what the tracker stated (φ = 1), or its data sheet
along and across the beam; the robot's own scatter of the point and of its joints. An unknown has a
prior N(0, ρ_g²) in tolerances. Restricted maximum likelihood in the linearised model is reached by
the fixed point of geodesy's variance components: each size² is multiplied by the squares that it
explains over its redundancy,

    group of unknowns   squares Σ x²/ρ²             redundancy Σ (1 - C_jj/ρ²)
    part of the noise   squares φ Σ v'W V_k W v     redundancy φ Σ tr V_k (W - W A C A' W)

with residuals v, weights W = (Σ φ_k V_k)⁻¹, derivatives A and posterior covariance C. A half-Cauchy
prior on each size, of one tolerance, adds 1 to the squares and 2 size² / (1 + size²) to the
redundancy: it keeps a size finite that no shot determines.

Data may at most halve a tolerance. One bad arm among good ones hides in the directions that the
others do not determine; without this floor it was wrong in 19 of 200 campaigns, with it in none.
"""

from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.fit.error_model import Linearised

SMALLEST_SIZE = 0.5
"""Floor of a group's size in tolerances."""
NOISE_RANGE = (1e-7, 1e6)
"""Range of the noise's factors, far beyond any instrument or robot."""
ROUNDS_OF_SIZES = 4
"""Rounds of the groups' sizes for each of the noise's, which costs far more."""


@dataclass(frozen=True, slots=True, eq=False)
class Components:
    """Sizes ρ of the groups in tolerances and factors φ of the noise's parts, by name."""

    sizes: dict[str, float]
    factors: dict[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class LinearModel:
    """Model linearised at the kept shots, from which the fixed point is computed."""

    at: Linearised
    noise: dict[str, Array]
    """Parts V_k, (N, 3, 3)."""
    kept: Mask
    """(N,)"""
    deviation: Array
    """Unknowns less their prior's mean, (Q,)."""
    fixed: Array
    """Precision (Q, Q) of priors that are not learned, of known lengths or a former result."""
    groups: dict[str, Index]
    """Places of the unknowns of each learned group."""

    def weights(self, factors: dict[str, float]) -> Array:
        """Return W = (Σ φ V)⁻¹ of each shot, (N, 3, 3), zero where it is not kept."""
        total = sum(factors[part] * covariance for part, covariance in self.noise.items())
        return np.asarray(self.kept[:, None, None] * np.linalg.inv(total))

    def precision(self, sizes: dict[str, float]) -> Array:
        """Return the precision (Q, Q) of all priors."""
        diagonal = np.zeros(len(self.fixed))
        for group, places in self.groups.items():
            diagonal[places] = sizes[group] ** -2
        return self.fixed + np.diag(diagonal)

    def normal_equations(self, weights: Array) -> tuple[Array, Array]:
        """Return A'WA (Q, Q) and A'Wr (Q,) of all shots."""
        jacobian = self.at.jacobian
        rows = jacobian.reshape(-1, jacobian.shape[2])
        weighted = (weights @ jacobian).reshape(rows.shape)
        return weighted.T @ rows, weighted.T @ self.at.residual.ravel()

    def solve(
        self, normal: tuple[Array, Array], sizes: dict[str, float]
    ) -> tuple[Array, Array, float]:
        """Return the posterior covariance (Q, Q), the Gauss-Newton step (Q,) and its gain in χ²."""
        precision = self.precision(sizes)
        slope = normal[1] + precision @ self.deviation
        covariance = np.asarray(np.linalg.inv(normal[0] + precision), dtype=np.float64)
        step = -covariance @ slope
        return covariance, step, float(-slope @ step)

    def objective(self, components: Components) -> float:
        """Return χ² of residuals and priors; infinite where a kept shot has no assembly."""
        weights, residual = self.weights(components.factors)[self.kept], self.at.residual[self.kept]
        value = np.einsum("ni,nij,nj->", residual, weights, residual)
        value += self.deviation @ self.precision(components.sizes) @ self.deviation
        return float(value) if np.isfinite(value) else np.inf


def estimate_components(
    model: LinearModel, start: Components, rounds: int, *, learn_sizes: bool
) -> Components:
    """Iterate the fixed point from a start; return sizes and factors."""
    sizes, factors = dict(start.sizes), dict(start.factors)
    for _ in range(rounds):
        weights = model.weights(factors)
        normal = model.normal_equations(weights)
        before = dict(sizes)
        for _ in range(ROUNDS_OF_SIZES):
            covariance, step, _ = model.solve(normal, sizes)
            if not learn_sizes:
                break
            for group, places in model.groups.items():
                size2 = sizes[group] ** 2
                squares = (((model.deviation + step)[places]) ** 2).sum() / size2
                redundancy = len(places) - np.diag(covariance)[places].sum() / size2
                ratio = _with_half_cauchy(squares, max(redundancy, 0.0), size2)
                sizes[group] = max(np.sqrt(size2 * np.clip(ratio, 0.1, 10.0)), SMALLEST_SIZE)
        ratios = _noise_ratios(model, factors, weights, covariance, step)
        for part, ratio in ratios.items():
            factors[part] = float(
                np.clip(factors[part] * np.clip(ratio, 0.01, 100.0), *NOISE_RANGE)
            )
        moving = [abs(np.log(ratio)) for part, ratio in ratios.items() if factors[part] > 1e-4]
        moved = [abs(np.log(sizes[group] / before[group])) for group in sizes]
        if max(moving, default=0.0) < 0.05 and max(moved, default=0.0) < 0.01:
            break
    return Components(sizes, factors)


def _with_half_cauchy(squares: float, redundancy: float, size2: float) -> float:
    """Return the ratio of squares to redundancy, with those of the prior on the size."""
    return (squares + 1.0) / (redundancy + 2.0 * size2 / (1.0 + size2))


def _noise_ratios(
    model: LinearModel, factors: dict[str, float], weights: Array, covariance: Array, step: Array
) -> dict[str, float]:
    """Return by how much each estimated part of the noise must be multiplied."""
    residuals = (weights @ (model.at.residual + model.at.jacobian @ step)[..., None])[..., 0]
    rows = weights @ model.at.jacobian
    spread = weights - (rows @ covariance) @ rows.swapaxes(1, 2)
    ratios = {}
    for part, covariance_of_part in model.noise.items():
        if part != "stated":
            factor = factors[part]
            squares = factor * np.einsum("ni,nij,nj->", residuals, covariance_of_part, residuals)
            redundancy = factor * float((covariance_of_part * spread).sum())
            ratios[part] = _with_half_cauchy(squares, max(redundancy, 0.0), factor)
    return ratios
