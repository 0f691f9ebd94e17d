"""The fit's algebra against dense matrices, its sizes against the likelihood they maximise."""

from dataclasses import replace

import numpy as np
import pytest
import scipy
from small_fits import (
    GROUPS,
    STATED_MM,
    at_minimum,
    dense,
    drawn_fit,
    log_marginal,
    model_of,
    observed,
    with_points,
)

from campaigns.fit import wrong_shots
from campaigns.fit.effects import Lag, Step, Walk
from campaigns.fit.error_model import BY_NAME
from campaigns.fit.error_sources import ARCMIN
from campaigns.fit.events import candidate_parts
from campaigns.fit.fit import (
    LARGEST_SIZE,
    SMALLEST_SIZE,
    Prior,
    estimate_sizes_and_noise,
    fit_model,
    integrate_sizes,
    log_evidence,
    noise_parts,
    refit,
    smallest_sizes,
    update_weights,
)

WEIGHTS = np.r_[np.ones(14), 0.5, 0.2, 0.05, 0.0, 0.0, 0.9]
ROBOT = ("offsets", "lengths", "axes", "sag")
COUNT = 11
"""Unknowns of a drawn fit without effects."""


def step_of_two(since=8.0, log_odds=0.0):
    """Change of two of the drawn unknowns."""
    return Step("arm 1", since, np.inf, (1.0, 2.0), (0, 1), COUNT, log_odds=log_odds)


def lengths_of(fit, value, std):
    """Prior of the scale by a known length, in tolerances."""
    tolerance = fit.model.tolerance[fit.model.names.index("scale")]
    return Prior(lengths={"scale": (value * tolerance, std * tolerance)})


@pytest.mark.parametrize("good", [None, WEIGHTS])
def test_the_step_is_that_of_weighted_least_squares_with_the_priors_as_rows(good):
    fit = drawn_fit(good=good)
    fit = replace(
        fit, sizes={**fit.sizes, "axes": 0.3, "sag": 4.0}, factors={**fit.factors, "joints": 3.0}
    )
    rows, residual, covariance = dense(fit)
    whitening = np.linalg.inv(np.linalg.cholesky(covariance))
    size = np.ones(fit.model.size)
    for place, group in enumerate(fit.model.groups):
        size[place] = {"axes": 0.3, "sag": 4.0}.get(group, 1.0)
    of_prior = np.eye(fit.model.size, rows.shape[1]) / size[:, None]
    stacked = np.concatenate([whitening @ rows, of_prior])
    right = -np.concatenate([whitening @ residual, fit.at.x / size])
    assert fit.step == pytest.approx(np.linalg.lstsq(stacked, right)[0], rel=1e-8, abs=1e-10)
    assert fit.inverse == pytest.approx(np.linalg.inv(stacked.T @ stacked), rel=1e-7, abs=1e-12)
    assert fit.objective == pytest.approx(right @ right)
    assert fit.gain == pytest.approx(right @ right - ((stacked @ fit.step - right) ** 2).sum())
    assert fit.gain == pytest.approx(fit.objective - at_minimum(fit).objective)
    assert np.abs(at_minimum(fit).step).max() < 1e-9


def test_a_shot_without_assembly_that_counts_makes_the_objective_infinite_and_no_other_does():
    fit = drawn_fit(good=WEIGHTS)
    residual = fit.at.residual.copy()
    residual[17] = np.nan
    assert np.isfinite(replace(fit, at=replace(fit.at, residual=residual)).objective)
    residual[0] = np.nan
    assert replace(fit, at=replace(fit.at, residual=residual)).objective == np.inf


def test_tolerances_are_a_precision_of_one_learned_groups_their_size_and_frames_are_flat():
    fit = drawn_fit(effects=(Lag(3),))
    fit = replace(fit, sizes={**fit.sizes, "axes": 0.5, "sag": 2.0, "lag": 10.0})
    of_group = {"offsets": 1.0, "scale": 1.0, "axes": 4.0, "sag": 0.25}
    expected = [of_group[group] for group in fit.model.groups] + [0.01] * 3 + [0.0] * 6
    assert fit.precision == pytest.approx(np.diag(expected))
    fixed, deviation = fit.prior_terms
    assert np.diag(fixed) == pytest.approx([e if e == 1.0 else 0.0 for e in expected])
    assert deviation == pytest.approx(np.r_[fit.at.x, np.zeros(6)])


def test_a_former_result_replaces_tolerances_and_sizes_but_those_of_effects():
    rng = np.random.default_rng(3)
    count = len(model_of("delta", *GROUPS).names)
    root, mean = rng.normal(size=(count, count)), rng.normal(size=count)
    prior = Prior(mean, root @ root.T, {"points": 0.3})
    fit = drawn_fit(effects=(Lag(3), step_of_two()), prior=prior)
    fixed, deviation = fit.prior_terms
    assert set(fit.groups) == {"lag", fit.model.effects[1].name}
    assert fit.precision[:count, :count] == pytest.approx(root @ root.T)
    assert np.diag(fit.precision)[count:] == pytest.approx(np.r_[np.ones(5), np.zeros(6)])
    assert np.diag(fixed)[count:] == pytest.approx(np.zeros(11))
    assert deviation[:count] == pytest.approx(fit.at.x[:count] - mean)
    assert deviation[count:] == pytest.approx(np.r_[fit.at.x[count:], np.zeros(6)])
    fixed_point = estimate_sizes_and_noise(fit, 3)
    assert fixed_point.factors["points"] == fit.factors["points"]
    assert fixed_point.factors["joints"] != fit.factors["joints"]
    assert fixed_point.sizes["axes"] == fit.sizes["axes"]
    assert fixed_point.sizes["lag"] != fit.sizes["lag"]


def test_without_data_a_known_length_gives_its_value_and_sigma():
    fit = drawn_fit(good=np.zeros(20))
    fit = replace(fit, prior=lengths_of(fit, value=7.0, std=0.2))
    place = fit.model.names.index("scale")
    precision, slope = fit.precision, fit.precision @ fit.prior_terms[1]
    assert precision[place, place] == pytest.approx(0.2**-2)
    step = -slope[:COUNT] / np.diag(precision)[:COUNT]
    assert (fit.at.x + step)[place] == pytest.approx(7.0)
    assert np.delete(fit.at.x + step, place) == pytest.approx(np.zeros(COUNT - 1), abs=1e-12)
    assert fit.measured == ("scale",)


def cost_of(fit, group, part):
    """-2 log of the restricted likelihood with weights, and of the half-Cauchy priors."""

    def cost(logs):
        sizes = {**fit.sizes, group: np.exp(0.5 * logs[0])}
        at = replace(fit, sizes=sizes, factors={**fit.factors, part: np.exp(logs[1])})
        value = (fit.good * np.linalg.slogdet(at.total_noise)[1]).sum()
        value += np.linalg.slogdet(at.inverse)[1] * -1.0
        value -= np.linalg.slogdet(at.precision[: at.model.size, : at.model.size])[1]
        value += at.objective - at.gain
        return value + (2.0 * np.log1p(np.exp(logs)) - logs).sum()

    return cost


def settled(fit, rounds=40):
    """Fit at the fixed point: each call takes a round at least, also where it would end."""
    for _ in range(rounds):
        fit = estimate_sizes_and_noise(fit, 3)
    return fit


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("good", "within"), [(None, 2e-3), (WEIGHTS >= 0.5, 2e-3), (WEIGHTS, 0.2)])
def test_sizes_and_noise_maximise_the_restricted_likelihood(seed, good, within):
    good = None if good is None else good.astype(float)
    fit = drawn_fit(seed, groups=("offsets", "axes", "scale"), good=good)
    fit = replace(fit, prior=Prior(factors={"joints": 1.0}))
    result = settled(fit)
    logs = [2.0 * float(np.log(result.sizes["axes"])), float(np.log(result.factors["points"]))]
    best = scipy.optimize.minimize(cost_of(fit, "axes", "points"), logs, method="Nelder-Mead")
    assert logs == pytest.approx(best.x.tolist(), abs=within)
    assert (result.factors["stated"], result.factors["joints"]) == (1.0, 1.0)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_restricted_likelihood_is_the_density_of_the_data_without_what_frames_may_be(seed):
    fit = drawn_fit(seed, groups=("offsets", "axes", "scale"))
    cost, logs = cost_of(fit, "axes", "points"), np.log([[0.5, 2.0], [3.0, 0.2]])
    exact = []
    for log_size2, log_factor in logs:
        sizes = {**fit.sizes, "axes": np.exp(0.5 * log_size2)}
        at = replace(fit, sizes=sizes, factors={**fit.factors, "points": np.exp(log_factor)})
        half_cauchy = sum(2.0 * np.log1p(np.exp(v)) - v for v in (log_size2, log_factor))
        exact.append(-2.0 * log_marginal(at) + half_cauchy)
    assert cost(logs[0]) - cost(logs[1]) == pytest.approx(exact[0] - exact[1], rel=1e-8)


def test_both_parts_of_the_noise_are_at_a_maximum_too():
    fit = settled(drawn_fit(5, shots=60, groups=("offsets", "axes")))
    at = np.array([np.log(fit.factors["points"]), np.log(fit.factors["joints"])])

    def value(logs):
        factors = {"stated": 1.0, "points": np.exp(logs[0]), "joints": np.exp(logs[1])}
        return (
            log_marginal(replace(fit, factors=factors))
            - (np.log1p(np.exp(logs)) - 0.5 * logs).sum()
        )

    gradient = [(value(at + d) - value(at - d)) / 0.02 for d in 0.01 * np.eye(2)]
    assert np.abs(gradient).max() < 0.01


def test_few_rounds_go_far_enough_from_an_absurd_start():
    fit = drawn_fit(2, groups=("offsets", "axes", "scale"))
    fit = replace(fit, prior=Prior(factors={"joints": 1.0}))
    absurd = replace(fit, sizes={"axes": 100.0}, factors={**fit.factors, "points": 1e4})
    far, near = estimate_sizes_and_noise(absurd, 6), settled(fit)
    assert far.sizes["axes"] == pytest.approx(near.sizes["axes"], rel=0.02)
    assert far.factors["points"] == pytest.approx(near.factors["points"], rel=0.15)
    once = estimate_sizes_and_noise(absurd, 1)
    assert once.factors["points"] >= 0.99 * 1e4 * 0.01


def test_the_size_of_a_change_does_not_fall_below_its_floor():
    still = replace(step_of_two(), usual=(1e-9, 1e-9))
    fit = drawn_fit(effects=(still, Lag(3)))
    jacobian = fit.at.jacobian.copy()
    jacobian[..., COUNT : COUNT + 5] = 0.0
    fit = replace(fit, at=replace(fit.at, x=0.0 * fit.at.x, jacobian=jacobian))
    assert smallest_sizes(fit.model) == {still.name: 1.0, "lag": 0.0}
    result = estimate_sizes_and_noise(
        replace(fit, sizes={**fit.sizes, still.name: 3.0, "lag": 3.0}), 60
    )
    assert result.sizes[still.name] == 1.0
    # a size that no shot determines is at the maximum of its half-Cauchy prior
    assert result.sizes["lag"] == pytest.approx(1.0, abs=0.01)


def test_a_tolerance_by_name_has_a_size_of_its_own_that_shots_may_make_small_or_large():
    """A parameter at nominal makes its tolerance small, one far beyond makes it large."""
    name = model_of("delta", *GROUPS).names[0]
    sizes = []
    for residual in (0.0, -40.0):
        fit = drawn_fit(at_zero=True, shots=40)
        at = replace(fit.at, residual=residual * fit.at.jacobian[..., 0])
        model = replace(fit.model, tolerances={name: fit.model.tolerance[0]})
        own = f"{BY_NAME}{name}"
        result = settled(replace(fit, model=model, at=at, sizes={**fit.sizes, own: 1.0}), 10)
        assert set(result.groups) == {*fit.groups, own}
        sizes.append(result.sizes[own])
    assert sizes[0] < SMALLEST_SIZE  # the floor is of the table's groups
    # the derivatives of the likelihood and of the half-Cauchy prior cancel: x²/ρ² + 1 = 1 + 2
    assert sizes[1] == pytest.approx(40.0 / np.sqrt(2.0), rel=0.02)


def test_of_weights_that_are_properties_of_errors_squares_of_weight_one_are_expected():
    good = np.full(40, 0.25)
    fit = replace(
        drawn_fit(3, shots=40, groups=("offsets",), good=good), prior=Prior(factors={"joints": 1.0})
    )
    plain = estimate_sizes_and_noise(fit, 60)
    cauchy = estimate_sizes_and_noise(fit, 60, is_cauchy=True)
    # the Cauchy weights of errors in their core shrink the squares, and with them the noise
    assert cauchy.factors["points"] < 0.5 * plain.factors["points"]


def test_information_on_further_columns_is_that_with_all_unknowns_integrated_out():
    fit = drawn_fit(good=np.r_[0.3, np.ones(19)])
    columns = np.random.default_rng(3).normal(size=(20, 3, 2))
    rows, _, covariance = dense(fit)
    flat = columns.reshape(60, 2)
    prior = np.linalg.inv(fit.precision[:COUNT, :COUNT])
    by = rows[:, :COUNT]
    # frames are flat: as good as a prior of 1e8
    whole = covariance + by @ prior @ by.T + 1e8 * rows[:, COUNT:] @ rows[:, COUNT:].T
    white = fit.whitened
    information = white.information(white.columns(columns))
    assert information == pytest.approx(flat.T @ np.linalg.solve(whole, flat), rel=1e-4)
    score = white.columns(columns).T @ white.residual
    expected = np.einsum("nik,nij,nj->k", columns, fit.weights, fit.residual)
    assert score == pytest.approx(expected)


def test_covariances_of_points_and_the_fit_without_each_shot_follow_from_the_posterior():
    fit = drawn_fit(good=WEIGHTS)
    expected = [rows @ fit.inverse @ rows.T for rows in fit.at.jacobian]
    assert fit.by_unknowns == pytest.approx(np.array(expected))
    for row in (0, 14, 16, 17):
        without = fit.good.copy()
        without[row] = 0.0
        other = replace(fit, good=without)
        residual, covariance = (part[row] for part in fit.cavity)
        assert residual == pytest.approx(other.residual[row], rel=1e-7)
        assert covariance == pytest.approx(fit.total_noise[row] + other.by_unknowns[row], rel=1e-7)


def test_sigma_is_the_root_of_the_covariance_and_spread_adds_to_it():
    fit = drawn_fit()
    assert fit.std == pytest.approx(np.sqrt(np.diag(fit.inverse)[:COUNT]))
    wide = replace(fit, spread=2.0 * np.eye(COUNT + 6))
    assert wide.std**2 == pytest.approx(fit.std**2 + 2.0)
    assert wide.model_covariance.shape == (COUNT, COUNT)
    assert (
        drawn_fit(good=np.r_[0.5, 0.49, np.ones(18)]).kept.tolist() == [True, False] + [True] * 18
    )


def test_scatter_is_in_mm_and_in_units_of_the_joints():
    fit = replace(drawn_fit(), factors={"stated": 1.0, "points": 4.0, "joints": 9.0})
    assert fit.scatter == pytest.approx((1.0, 15.0 * ARCMIN))
    rails = replace(fit, model=model_of("linear-delta", "offsets"))
    assert rails.scatter == pytest.approx((1.0, 0.3))
    by_joint = np.random.default_rng(1).normal(size=(20, 3, 3))
    parts = noise_parts(fit.model, fit.observations, by_joint)
    assert list(parts) == ["stated", "points", "joints"]
    assert parts["points"] == pytest.approx(np.broadcast_to(0.25 * np.eye(3), (20, 3, 3)))
    expected = (5.0 * ARCMIN) ** 2 * np.einsum("nij,nkj->nik", by_joint, by_joint)
    assert parts["joints"] == pytest.approx(expected)


def test_weights_are_the_probabilities_by_the_fit_without_each_shot():
    fit, _ = update_weights(drawn_fit(4, shots=40))
    for _ in range(20):
        fit, change = update_weights(fit)
    share = wrong_shots.share_of_wrong(fit.good, fit.usable)
    good, wrong = wrong_shots.log_densities(*fit.cavity)
    again = wrong_shots.probabilities_of_good(good, wrong, share, fit.usable)
    assert change < 0.02
    assert fit.good == pytest.approx(again, abs=0.02)


# Evidence


def exact_evidence(fit):
    """Log marginal likelihood of the kept shots, the density of wrong ones, and all priors."""
    kept = replace(fit, good=(fit.kept & fit.usable) * 1.0)
    value = log_marginal(kept)
    for rho in [fit.sizes[group] for group in fit.groups] + [
        factor**0.5 for part, factor in fit.factors.items() if part != "stated"
    ]:
        value += np.log(rho) - np.log(1.0 + rho**2)
    rows = np.flatnonzero(fit.usable & ~fit.kept)
    densities = []
    for row in rows:
        normal = np.concatenate([kept.at.jacobian[row]])
        covariance = kept.total_noise[row] + normal @ kept.inverse @ normal.T
        mean = kept.residual[row]
        densities.append(
            np.mean(
                [
                    scipy.stats.multivariate_normal(
                        np.zeros(3), covariance + size**2 * np.eye(3)
                    ).pdf(mean)
                    for size in wrong_shots.SIZES_MM
                ]
            )
        )
    value += np.log(densities).sum() + len(rows) * 1.5 * np.log(2.0 * np.pi)
    missing, count = int((~(fit.kept & fit.usable)).sum()), len(fit.good)
    value += scipy.special.betaln(missing + 1.0, count - missing + 50.0)
    return value + sum(effect.log_odds for effect in fit.model.effects)


def test_differences_of_evidence_are_those_of_the_exact_marginal_likelihood():
    effects = (Lag(3), step_of_two(log_odds=-4.0))
    good = np.r_[np.ones(17), 0.3, 0.0, 1.0]
    whole = drawn_fit(effects=effects)
    fits = []
    for keep, sizes, factor, weights in (
        ((0, 1), (0.5, 2.0, 3.0), 2.0, None),
        ((0, 1), (1.5, 0.3, 1.0), 0.7, good),
        ((1,), (1.5, 0.3, 1.0), 0.7, good),
        ((), (1.5, 0.3, 1.0), 0.7, None),
    ):
        kept = [*range(COUNT), *(COUNT + k for k in range(5) if int(k >= 3) in keep)]
        columns = [*kept, *range(COUNT + 5, COUNT + 11)]
        model = whole.model.with_effects(tuple(effects[k] for k in keep))
        fit = replace(
            whole, model=model, good=np.ones(20) if weights is None else weights,
            at=replace(whole.at, x=whole.at.x[kept], jacobian=whole.at.jacobian[..., columns]),
            sizes=dict(zip(("axes", "sag", "lag"), sizes, strict=True)) | {effects[1].name: 2.5},
            factors={"stated": 1.0, "points": factor, "joints": 1.3},
        )  # fmt: skip
        counted = replace(fit, good=(fit.good >= 0.5) * 1.0)
        moved = at_minimum(counted)
        fits.append(replace(moved, good=fit.good))
    # frames are flat: the volume that their columns leave is a constant of the shots that count
    constants = []
    for fit in fits:
        rows = dense(replace(fit, good=fit.kept * 1.0))[0]
        volume = 0.5 * np.linalg.slogdet(rows[:, -6:].T @ rows[:, -6:])[1]
        constants.append(log_evidence(fit) - exact_evidence(fit) + volume)
    assert constants == pytest.approx([constants[0]] * 4, abs=1e-6)


def test_a_shot_without_assembly_counts_as_missing_and_has_no_density():
    fit = at_minimum(drawn_fit(good=np.r_[0.0, np.ones(19)]))
    usable = np.arange(20) > 0
    _, wrong = wrong_shots.log_densities(*fit.cavity)
    difference = log_evidence(fit) - log_evidence(replace(fit, usable=usable))
    assert difference == pytest.approx(wrong[0])


# Averages over sizes


def by_brute_force(fit, group):
    """Mean (Q,) and covariance (Q, Q) of all unknowns over a fine grid of one size."""
    logs, means, covariances = [], [], []
    for size in np.geomspace(SMALLEST_SIZE, LARGEST_SIZE, 1001):
        at = replace(fit, sizes={**fit.sizes, group: float(size)})
        logs.append(log_marginal(at) + np.log(size) - np.log1p(size**2))
        means.append(at.step)
        covariances.append(at.inverse)
    weights = np.exp(np.array(logs) - max(logs))
    weights /= weights.sum()
    mean = weights @ np.array(means)
    centred = np.array(means) - mean
    return mean, np.einsum("s,spq->pq", weights, covariances) + (centred.T * weights) @ centred


def robot_fit(*groups, shots=16, seed=2, effects=(), size=1.0, noise_mm=STATED_MM):
    model = model_of("delta", *groups)
    x = size * np.random.default_rng(seed).standard_normal(len(model.names))
    shots = observed(model, shots, seed=seed, x=x, noise_mm=noise_mm)
    return fit_model(model.with_effects(effects), shots)


@pytest.mark.parametrize(("size", "noise_mm"), [(0.05, STATED_MM), (3.0, STATED_MM), (1.0, 0.2)])
def test_estimates_and_covariance_are_averaged_over_what_a_size_may_be(size, noise_mm):
    """By 150 draws: means to a tenth of σ, σ to 10 %."""
    fit = robot_fit("offsets", "axes", shots=12, seed=4, size=size, noise_mm=noise_mm)
    assert set(fit.groups) == {"axes"}
    mean, covariance = by_brute_force(fit, "axes")
    result = integrate_sizes(fit)
    sigma = np.sqrt(np.diag(covariance)[: fit.model.size])
    moved = (result.at.x - fit.at.x) / sigma
    assert moved == pytest.approx(mean[: fit.model.size] / sigma, abs=0.1)
    assert result.std == pytest.approx(sigma[: len(result.std)], rel=0.1)
    assert result.covariance == pytest.approx(result.covariance.T)
    assert np.linalg.eigvalsh(result.covariance)[0] > 0.0


def test_averages_are_the_same_for_the_same_shots_and_leave_effects_at_their_likeliest_size():
    model = model_of("delta", "offsets", "axes")
    step = candidate_parts(model)["encoder 0"]
    moved = replace(step, since=6.0)
    fit = fit_model(model.with_effects((moved,)), observed(model, 12, seed=4))
    first, second = integrate_sizes(fit), integrate_sizes(fit)
    assert (first.covariance == second.covariance).all()
    assert first.sizes == fit.sizes
    where = fit.model.effect_places[0]
    shrunk = first.covariance[where, where] / fit.inverse[where, where]
    assert 0.5 < float(shrunk.min()) < 2.0


# Whole fits of robots


@pytest.mark.parametrize("name", ["par4-prototype", "linear-delta"])
def test_a_robot_of_large_errors_comes_back_with_its_sigma(name):
    model = model_of(name)
    x = 0.05 * np.random.default_rng(5).standard_normal(len(model.names))
    fit = fit_model(model, observed(model, 60, x=x))
    assert fit.has_converged
    assert fit.updates >= 2
    assert fit.gain < 0.01
    chi2 = (fit.x - x) @ np.linalg.solve(fit.model_covariance, fit.x - x)
    assert chi2 < 1.5 * len(x)
    assert (fit.at.residual**2).mean() ** 0.5 < 1.1 * STATED_MM


def test_a_step_too_far_is_shortened():
    """Parts 40 mm and angles far off: full steps raise χ² and lead nowhere."""
    model = model_of("linear-delta", "offsets", "lengths", "axes", "bars")
    x = 8.0 * np.random.default_rng(3).standard_normal(len(model.names))
    fit = fit_model(model, observed(model, 16, seed=3, x=x))
    assert fit.has_converged
    assert fit.rounds < 20


def test_steps_that_overshoot_to_and_fro_come_to_an_end():
    """Tilts times places on the plate: whole steps of this robot never settle."""
    model = model_of("delta")
    x = np.random.default_rng(3).standard_normal(len(model.names))
    fit = fit_model(model, observed(model, 30, seed=3, x=x))
    assert fit.has_converged
    assert fit.rounds < 20


def test_degrees_of_freedom_are_the_coordinates_less_those_that_unknowns_use_up():
    fit = drawn_fit(good=WEIGHTS)
    rows, _, covariance = dense(fit)
    hat = rows @ fit.inverse @ rows.T @ np.linalg.inv(covariance)
    assert fit.freedom == pytest.approx(3.0 * WEIGHTS.sum() - np.trace(hat))


def test_a_shot_without_assembly_has_no_influence():
    model = model_of("delta", *ROBOT)
    observations = observed(model, 21)
    joints = observations.joints.copy()
    joints[7] = [2.0, -2.0, 2.5]
    with_bad = fit_model(model, replace(observations, joints=joints))
    without = fit_model(model, observations.rows(np.delete(np.arange(21), 7)))
    assert not with_bad.usable[7]
    assert with_bad.good[7] == 0.0
    assert with_bad.usable.sum() == 20
    assert with_bad.x / without.std == pytest.approx(without.x / without.std, abs=1e-3)
    assert with_bad.std == pytest.approx(without.std, rel=1e-3)


def test_wrong_shots_are_left_out_and_the_others_decide():
    model = model_of("delta", *ROBOT)
    observations = observed(model, 40)
    rows, points = [3, 20, 29], observations.points.copy()
    points[rows] += [[0.3, 0.0, 0.2], [0.0, -40.0, 1.0], [300.0, 100.0, 0.0]]
    fit = fit_model(model, with_points(observations, points))
    assert np.flatnonzero(~fit.kept).tolist() == rows
    without = fit_model(model, observations.rows(np.delete(np.arange(40), rows)))
    assert fit.x / without.std == pytest.approx(without.x / without.std, abs=0.02)
    residual, _ = fit.cavity
    assert residual[3] == pytest.approx([-0.3, 0.0, -0.2], abs=0.08)


def test_a_third_of_wrong_shots_of_one_size_do_not_hide_in_the_scatter():
    model = model_of("delta", *ROBOT)
    observations = observed(model, 45)
    rng, points = np.random.default_rng(8), observations.points.copy()
    rows = np.sort(rng.permutation(45)[:14])
    points[rows] += rng.normal(size=(14, 3))
    fit = fit_model(model, with_points(observations, points))
    assert np.flatnonzero(~fit.kept).tolist() == rows.tolist()
    assert fit.scatter[0] < 0.02


def test_the_scatter_of_a_robot_is_estimated():
    model = model_of("delta", *ROBOT)
    rng = np.random.default_rng(9)
    observations = observed(model, 60, noise_mm=0.05)
    fit = fit_model(model, observations)
    of_point = np.hypot(fit.scatter[0], STATED_MM)
    assert of_point == pytest.approx(0.05, rel=0.25)
    joints = observed(model, 60).joints + 1e-3 * rng.standard_normal((60, 3))
    fit = fit_model(model, replace(observed(model, 60), joints=joints))
    assert fit.scatter[1] == pytest.approx(1e-3, rel=0.25)
    assert fit.scatter[0] < 0.1


def test_refits_keep_values_sizes_and_frames_of_effects_by_name():
    model = model_of("delta", *ROBOT, effects=())
    places = np.flatnonzero([group == "offsets" for group in model.groups])
    lag, walk = Lag(3), Walk(0)
    step = Step("encoder 1", 12.0, np.inf, (0.02,), (int(places[1]),), len(model.names))

    def change(row, x, joints):
        moved = x.copy()
        moved[places[1]] += 0.4 * (row >= 12)
        return moved, joints

    start = fit_model(model.with_effects((lag, step, walk)), observed(model, 30, change=change))
    again = refit(start, model.with_effects((step, walk)))
    z = start.at.x[start.model.effect_places[1]]
    assert z == pytest.approx([20.0], rel=0.1)
    assert again.at.x[again.model.effect_places[0]] == pytest.approx(z, rel=0.02)
    assert again.rounds <= 4
    assert again.has_converged
    swapped = refit(start, model.with_effects((walk, step, lag)))
    assert swapped.rounds <= 4
    assert swapped.sizes[step.name] == pytest.approx(start.sizes[step.name], rel=0.05)
    assert swapped.at.x[swapped.model.effect_places[1]] == pytest.approx(z, rel=0.01)
    assert integrate_sizes(start).spread is not None
    assert refit(integrate_sizes(start)).spread is None


def test_walks_of_two_sessions_share_a_name_and_keep_their_own_values():
    model = model_of("delta", *ROBOT, effects=(Walk(0), Walk(1)))
    observations = observed(model, 40, sessions=2)
    drift = np.outer(
        np.where(observations.frame == 1, np.linspace(-1, 1, 40), 0.0), [0.3, 0.0, 0.0]
    )
    start = fit_model(model, with_points(observations, observations.points + drift))
    first, second = (start.at.x[where] for where in start.model.effect_places)
    assert np.abs(second).max() > 3.0 * np.abs(first).max()
    again = refit(start)
    assert again.rounds <= 4
    assert again.at.x[again.model.effect_places[1]] == pytest.approx(second, rel=0.05, abs=0.1)


def test_a_refit_to_other_shots_starts_in_the_frames_and_noise_of_the_fit():
    model = model_of("delta", *ROBOT)
    observations = observed(model, 40)
    start = fit_model(model, observations.rows(np.arange(30)))
    joints = observations.joints.copy()
    joints[35] = [2.0, -2.0, 2.5]
    whole = refit(start, observations=replace(observations, joints=joints))
    assert len(whole.good) == 40
    assert np.flatnonzero(~whole.usable).tolist() == [35]
    direct = fit_model(model, observations.rows(np.delete(np.arange(40), 35)))
    assert whole.x / direct.std == pytest.approx(direct.x / direct.std, abs=0.02)
    assert whole.rounds <= 4
