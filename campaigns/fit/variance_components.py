"""Sizes of groups of unknowns and factors of parts of the noise, by one fixed point.

Theory of operation. The noise of a shot is Σ φ_k V_k over its parts: the covariance that the
tracker stated (φ = 1), or its data sheet along and across the beam; the scatter of the robot's
point, and of its joints. An unknown of group g has the prior N(0, ρ_g²) in tolerances. All φ and ρ
but those of stated parts are estimated from the shots, by restricted maximum likelihood (REML) in
the linearised model with a half-Cauchy prior on each size. Its maximum is reached by the fixed
point of geodesy's variance components (Helmert, Förstner): each variance φ or ρ² is multiplied by
the squares that it explains over its redundancy, the number of unknowns or coordinates by which the
shots determine it,

    group of unknowns   squares Σ x²/ρ²             redundancy Σ (1 - C_jj/ρ²)
    part of the noise   squares φ Σ v'W V_k W v     redundancy φ Σ tr V_k (W - W A C A' W)

with residuals v, weights W = (Σ φ_k V_k)⁻¹, derivatives A and posterior covariance C.
"""

from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.fit.error_model import Linearised

SMALLEST_SIZE = 0.5
"""Floor of a group's size: data may at most halve a tolerance. One bad arm among good ones hides in
directions that the others do not determine; without the floor its parameters were wrong in 19 of
200 campaigns, with it in none."""
NOISE_RANGE = (1e-7, 1e6)
"""Range of the noise's factors, far beyond any instrument or robot."""
ROUNDS_OF_SIZES = 4
"""Rounds of the sizes of groups in each round of the noise, which costs far more: new weights need
new normal equations, new sizes only another inverse of them."""


@dataclass(frozen=True, slots=True, eq=False)
class Components:
    """Sizes ρ of the groups in tolerances and factors φ of the noise's parts, by name."""

    sizes: dict[str, float]
    factors: dict[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Minimum of χ² in the linearised model."""

    covariance: Array
    """Posterior covariance of the unknowns, (Q, Q)."""
    step: Array
    """Gauss-Newton step from the point of linearisation, (Q,)."""
    gain: float
    """Fall of χ² by the step."""


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
    """Precision (Q, Q) of the priors whose size is not learned."""
    groups: dict[str, Index]
    """Places of the unknowns of each group whose size is learned."""

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

    def solve(self, normal: tuple[Array, Array], sizes: dict[str, float]) -> Solution:
        """Solve the normal equations A'WA (Q, Q), A'Wr (Q,) with priors of these sizes."""
        precision = self.precision(sizes)
        slope = normal[1] + precision @ self.deviation  # half the gradient of χ²
        covariance = np.asarray(np.linalg.inv(normal[0] + precision), dtype=np.float64)
        step = -covariance @ slope
        return Solution(covariance, step, float(-slope @ step))

    def solve_with(self, components: Components) -> Solution:
        """Solve the linearised model with sizes of groups and factors of the noise."""
        weights = self.weights(components.factors)
        return self.solve(self.normal_equations(weights), components.sizes)

    def objective(self, components: Components) -> float:
        """Return χ² of residuals and priors; infinite where a kept shot has no assembly."""
        weights, residual = self.weights(components.factors)[self.kept], self.at.residual[self.kept]
        value = np.einsum("ni,nij,nj->", residual, weights, residual)
        value += self.deviation @ self.precision(components.sizes) @ self.deviation
        return float(value) if np.isfinite(value) else np.inf


# In each round sizes come first, four times with the same weights, then the noise. Squares are of
# residuals and unknowns at the minimum of the linearised model. Changes in a round are limited, for
# far from the fixed point ratios may be absurd. Rounds end when no size changes by 1 %, and no
# noticeable part of the noise by 5 % of its variance.
def estimate_components(
    model: LinearModel, start: Components, rounds: int, *, learn_sizes: bool
) -> Components:
    """Iterate the fixed point from a start, at most `rounds` times; return sizes and factors."""
    sizes, factors = dict(start.sizes), dict(start.factors)
    for _ in range(rounds):
        weights = model.weights(factors)
        normal = model.normal_equations(weights)
        before = dict(sizes)
        for _ in range(ROUNDS_OF_SIZES):
            solution = model.solve(normal, sizes)
            if not learn_sizes:
                break
            x, variances = model.deviation + solution.step, np.diag(solution.covariance)
            for group, places in model.groups.items():
                size2 = sizes[group] ** 2
                squares = (x[places] ** 2).sum() / size2
                redundancy = len(places) - variances[places].sum() / size2
                ratio = _ratio_with_prior(squares, max(redundancy, 0.0), size2)
                sizes[group] = max(np.sqrt(size2 * np.clip(ratio, 0.1, 10.0)), SMALLEST_SIZE)
        ratios = _noise_ratios(model, factors, weights, solution)
        for part, ratio in ratios.items():
            changed = factors[part] * np.clip(ratio, 0.01, 100.0)
            factors[part] = float(np.clip(changed, *NOISE_RANGE))
        noise_changes = [
            abs(np.log(ratio)) for part, ratio in ratios.items() if factors[part] > 1e-4
        ]
        size_changes = [abs(np.log(sizes[group] / before[group])) for group in sizes]
        if max(noise_changes, default=0.0) < 0.05 and max(size_changes, default=0.0) < 0.01:
            break
    return Components(sizes, factors)


# By λ = log ρ² the derivative of -2 log likelihood is redundancy - squares. The half-Cauchy density
# 1 / (1 + ρ²) of a size is ρ / (1 + ρ²) as a density of log ρ; -2 log of it is 2 log(1 + ρ²) - λ,
# with the derivative 2 ρ² / (1 + ρ²) - 1. Both derivatives cancel at the posterior's maximum, where
# this ratio is 1. For a part of the noise φ is its ρ², for its scale is a tolerance too.
def _ratio_with_prior(squares: float, redundancy: float, size2: float) -> float:
    """Return squares over redundancy, each with the share of the half-Cauchy prior on the size."""
    return (squares + 1.0) / (redundancy + 2.0 * size2 / (1.0 + size2))


# With u = W v of the residuals v after the step, squares are φ Σ u'V_k u. The covariance of v is
# W⁻¹ - A C A' if the model holds, so that W (W⁻¹ - A C A') W = W - W A C A' W is that of u, and the
# redundancy φ Σ tr V_k (W - W A C A' W) is what these squares are expected to be.
def _noise_ratios(
    model: LinearModel, factors: dict[str, float], weights: Array, solution: Solution
) -> dict[str, float]:
    """Return by how much the variance of each estimated part of the noise must be multiplied."""
    residuals = model.at.residual + model.at.jacobian @ solution.step
    u = (weights @ residuals[..., None])[..., 0]
    rows = weights @ model.at.jacobian
    expected = weights - (rows @ solution.covariance) @ rows.swapaxes(1, 2)
    ratios = {}
    for part, covariance in model.noise.items():
        if part != "stated":
            factor = factors[part]
            squares = factor * np.einsum("ni,nij,nj->", u, covariance, u)
            redundancy = factor * float((covariance * expected).sum())
            ratios[part] = _ratio_with_prior(squares, max(redundancy, 0.0), factor)
    return ratios
