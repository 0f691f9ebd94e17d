"""Probabilities of shots to be wrong: the fit without each shot, densities, and priors."""

from dataclasses import replace
from math import comb

import numpy as np
import pytest
import scipy
from small_fits import drawn_fit

from campaigns.fit import wrong_shots

ALL = np.ones(40, dtype=bool)


@pytest.mark.parametrize("weight", [1.0, 0.3, 0.0])
def test_one_formula_judges_followed_and_left_out_shots_as_if_they_were_left_out(weight):
    fit = drawn_fit(good=np.r_[weight, np.ones(19)])
    without = replace(fit, good=np.r_[0.0, np.ones(19)])
    residual, covariance = wrong_shots.cavity(
        fit.residual, fit.by_unknowns, fit.total_noise, fit.good
    )
    assert residual[0] == pytest.approx(without.residual[0], rel=1e-9)
    expected = fit.total_noise[0] + without.by_unknowns[0]
    assert covariance[0] == pytest.approx(expected, rel=1e-9)


def test_densities_are_those_of_normal_errors_and_of_a_mixture_of_sizes():
    rng = np.random.default_rng(1)
    root, residual = rng.normal(size=(5, 3, 3)), 4.0 * rng.normal(size=(5, 3))
    covariance = root @ root.swapaxes(1, 2) + np.eye(3)
    good, wrong = wrong_shots.log_densities(residual, covariance)
    constant = 1.5 * np.log(2.0 * np.pi)
    for row in range(5):
        normal = scipy.stats.multivariate_normal
        assert good[row] - constant == pytest.approx(
            normal(np.zeros(3), covariance[row]).logpdf(residual[row])
        )
        mixture = [
            normal(np.zeros(3), covariance[row] + size**2 * np.eye(3)).pdf(residual[row])
            for size in (0.1, 10**-0.5, 1.0, 10**0.5, 10.0, 10**1.5, 100.0)
        ]
        assert wrong[row] - constant == pytest.approx(np.log(np.mean(mixture)))


def test_the_larger_its_residual_the_likelier_a_shot_is_wrong():
    residual = np.zeros((40, 3))
    residual[:, 0] = 0.01 * np.r_[np.zeros(25), np.arange(15.0)]
    densities = wrong_shots.log_densities(residual, np.broadcast_to(1e-4 * np.eye(3), (40, 3, 3)))
    probability = wrong_shots.probabilities_of_good(*densities, 0.02, ALL)
    assert (np.diff(probability[25:]) < 0.0).all()
    assert probability[0] > 0.99
    assert probability[-1] < 1e-6


def test_of_equal_densities_the_share_decides_and_unusable_shots_are_never_good():
    usable = np.arange(40) > 3
    probability = wrong_shots.probabilities_of_good(np.zeros(40), np.zeros(40), 0.2, usable)
    assert probability == pytest.approx(0.8 * usable)
    odds = wrong_shots.probabilities_of_good(np.zeros(40), np.full(40, -1.0), 0.2, ALL)
    assert odds == pytest.approx(np.full(40, 4.0 * np.e / (1.0 + 4.0 * np.e)))


@pytest.mark.parametrize("usable", [ALL, np.arange(40) < 30, np.arange(40) < 31])
def test_at_most_half_of_the_usable_shots_are_wrong_and_the_likelier_half_is_kept(usable):
    wrong = np.where(usable, np.linspace(50.0, 90.0, 40)[::-1], -100.0)
    probability = wrong_shots.probabilities_of_good(np.zeros(40), wrong, 0.02, usable)
    half = np.flatnonzero(usable)[usable.sum() // 2 :]
    assert np.flatnonzero(probability).tolist() == half.tolist()
    assert set(probability.tolist()) == {0.0, 1.0}
    assert probability.dtype == np.float64
    # a minority of wrong shots is left to their densities
    wrong = np.where(np.arange(40) < 12, 50.0, -50.0)
    probability = wrong_shots.probabilities_of_good(np.zeros(40), wrong, 0.02, usable)
    assert probability == pytest.approx((np.arange(40) >= 12) * usable * 1.0, abs=1e-12)


def test_the_share_of_wrong_shots_is_the_mean_of_its_beta_posterior():
    usable = np.arange(40) < 30
    probability = np.where(usable, 0.9, 0.0)
    expected = scipy.stats.beta(1.0 + 3.0, 50.0 + 27.0).mean()
    assert wrong_shots.share_of_wrong(probability, usable) == pytest.approx(expected)
    assert wrong_shots.share_of_wrong(np.zeros(400), np.ones(400, dtype=bool)) == 0.5


def test_first_weights_are_those_of_cauchy_errors_in_space():
    def log_density(chi2):
        return scipy.stats.multivariate_t(np.zeros(3), df=1).logpdf([np.sqrt(chi2), 0.0, 0.0])

    chi2 = np.array([0.1, 1.0, 7.0, 100.0])
    slope = [(log_density(c * 1.001) - log_density(c * 0.999)) / (0.002 * c) for c in chi2]
    assert wrong_shots.cauchy_weights(chi2) == pytest.approx(-2.0 * np.array(slope), rel=1e-4)


def test_a_concentration_step_keeps_the_sixty_percent_that_fit_best():
    usable = np.arange(40) >= 10
    chi2 = np.where(usable, np.arange(40.0)[::-1], 0.0)
    core = wrong_shots.core_of(chi2, usable)
    assert core.tolist() == [0.0] * 22 + [1.0] * 18


@pytest.mark.parametrize("count", [1, 7, 30])
def test_the_probabilities_of_all_sets_of_wrong_shots_add_up(count):
    total = sum(
        comb(count, wrong) * np.exp(wrong_shots.log_prior_of_count(wrong, count))
        for wrong in range(count + 1)
    )
    assert total == pytest.approx(scipy.special.beta(1.0, 50.0))
    one, none = (wrong_shots.log_prior_of_count(wrong, count) for wrong in (1, 0))
    assert one - none == pytest.approx(np.log(1.0 / (count + 49.0)))
