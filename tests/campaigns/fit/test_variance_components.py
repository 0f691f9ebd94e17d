"""Sizes of groups and of the noise against the likelihood that they are to maximise."""

import numpy as np
import pytest
import scipy
from campaigns.fit.variance_components import Components, LinearModel, estimate_components

from campaigns.fit.error_model import Linearised

SHOTS, UNKNOWNS, ALWAYS = 60, 24, 2
"""Shots and unknowns, of which the last ones have a prior that is not learned."""


def linear_model(size: float, noise_mm: float, seed: int) -> LinearModel:
    """Draw unknowns of a size and residuals of them with noise, about a prior's mean of 0.5."""
    random = np.random.default_rng(seed)
    jacobian = random.normal(size=(SHOTS, 3, UNKNOWNS))
    deviation = np.full(UNKNOWNS, -0.5)
    unknowns = size * random.normal(size=UNKNOWNS) - deviation
    noise = noise_mm * np.array([0.5, 0.5, 1.0]) * random.normal(size=(SHOTS, 3))
    residual = -jacobian @ unknowns + noise
    fixed = np.diag([0.0] * (UNKNOWNS - ALWAYS) + [0.01] * ALWAYS)
    parts = {"stated": 1e-4 * np.eye(3), "points": np.diag([1.0, 1.0, 4.0]) / 4.0}
    return LinearModel(
        Linearised(np.zeros(UNKNOWNS), (), None, residual, jacobian, None),
        {part: np.broadcast_to(covariance, (SHOTS, 3, 3)) for part, covariance in parts.items()},
        np.arange(SHOTS) % 10 > 0,
        deviation,
        fixed,
        {"arms": np.arange(UNKNOWNS - ALWAYS)},
    )


def maximum_of_the_likelihood(model: LinearModel) -> np.ndarray:
    """Return log ρ² of the group and log φ of the noise by the density of the data themselves."""
    rows = model.at.jacobian[model.kept].reshape(-1, UNKNOWNS)
    data = model.at.residual[model.kept].ravel() - rows @ model.deviation
    blocks = np.kron(np.eye(model.kept.sum()), model.noise["points"][0])
    stated = np.kron(np.eye(model.kept.sum()), model.noise["stated"][0])

    def cost(logs: np.ndarray) -> float:
        prior = np.r_[np.full(UNKNOWNS - ALWAYS, np.exp(logs[0])), np.full(ALWAYS, 100.0)]
        covariance = rows * prior @ rows.T + stated + np.exp(logs[1]) * blocks
        chi2 = data @ np.linalg.solve(covariance, data)
        half_cauchy = (2.0 * np.log1p(np.exp(logs)) - logs).sum()
        return np.linalg.slogdet(covariance)[1] + chi2 + half_cauchy

    return scipy.optimize.minimize(cost, [0.0, 0.0], method="Nelder-Mead").x


@pytest.mark.parametrize(
    ("size", "noise_mm", "seed"), [(2.0, 0.5, 1), (5.0, 0.05, 2), (0.9, 2.0, 3)]
)
def test_sizes_and_noise_maximise_the_likelihood_of_the_data(size, noise_mm, seed):
    model = linear_model(size, noise_mm, seed)
    start = Components({"arms": 1.0}, {"stated": 1.0, "points": 1.0})
    result = estimate_components(model, start, 50, learn_sizes=True)
    logs = [2.0 * np.log(result.sizes["arms"]), np.log(result.factors["points"])]
    assert logs == pytest.approx(maximum_of_the_likelihood(model), abs=0.03)
    assert result.factors["stated"] == 1.0


def test_a_size_falls_to_its_floor_where_nothing_deviates_and_stays_if_it_is_not_learned():
    model = linear_model(0.0, 0.1, 4)
    start = Components({"arms": 3.0}, {"stated": 1.0, "points": 1.0})
    assert estimate_components(model, start, 50, learn_sizes=True).sizes == {"arms": 0.5}
    held = estimate_components(model, start, 50, learn_sizes=False)
    assert held.sizes == {"arms": 3.0}
    assert held.factors["points"] == pytest.approx(0.1**2, rel=0.3)


def test_few_rounds_go_far_enough_from_an_absurd_start():
    model = linear_model(2.0, 0.5, 1)
    start = Components({"arms": 100.0}, {"stated": 1.0, "points": 1e4})
    far = estimate_components(model, start, 6, learn_sizes=True)
    true = Components({"arms": 2.0}, {"stated": 1.0, "points": 0.25})
    near = estimate_components(model, true, 50, learn_sizes=True)
    assert far.sizes["arms"] == pytest.approx(near.sizes["arms"], rel=0.02)
    assert far.factors["points"] == pytest.approx(near.factors["points"], rel=0.05)


def test_the_minimum_is_that_of_the_objective():
    model = linear_model(2.0, 0.5, 5)
    components = Components({"arms": 2.0}, {"stated": 1.0, "points": 1.0})
    solution = model.solve_with(components)
    residual = model.at.residual + model.at.jacobian @ solution.step
    at = Linearised(solution.step, (), None, residual, model.at.jacobian, None)
    there = LinearModel(
        at, model.noise, model.kept, model.deviation + solution.step, model.fixed, model.groups
    )
    fall = model.objective(components) - there.objective(components)
    assert fall == pytest.approx(solution.gain, rel=1e-9)
    assert np.abs(there.solve_with(components).step).max() < 1e-9
