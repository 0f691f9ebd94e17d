"""Periods of drives: the scan against dense matrices, ripples by truth, and rates of the robot."""

from dataclasses import replace

import numpy as np
import pytest
from small_fits import FRAME, log_bayes_factor, model_of, observed

from campaigns.fit import events, periods
from campaigns.fit.effects import RateError, Ripple, Walk
from campaigns.fit.error_sources import ARCSEC
from campaigns.fit.fit import fit_model, log_evidence, settle

MODEL = model_of("delta", "offsets", "lengths", "axes", "sag")
STAND = MODEL.with_effects((Walk(0),))


@pytest.fixture(scope="module")
def noisy():
    """A fit with a stand, a shot of half weight and one that is left out."""
    fit = fit_model(STAND, observed(MODEL, 24, noise_mm=0.02))
    good = fit.good.copy()
    good[[5, 11]] = [0.01, 0.5]
    return replace(fit, good=good)


def test_the_scan_over_periods_has_the_exact_factors_of_waves_in_all_arms_and_in_each(noisy):
    result = periods.scan_periods(noisy)
    assert result.rates[0] == 6.0
    assert result.rates[-1] < 250.0
    step = np.diff(result.rates)
    assert step == pytest.approx(0.5 * np.pi / np.ptp(noisy.observations.joints, axis=0).max())
    for row in (0, 40):
        exact = []
        for arms in ((0, 1, 2), (0,), (1,), (2,)):
            ripple = Ripple(arms, float(result.rates[row]), 0.1, 20 * ARCSEC, 0.0)
            exact.append(log_bayes_factor(noisy, ripple, {ripple.name: 1.0}))
        assert result.log_factors[row] == pytest.approx(exact, abs=1e-4)


def test_the_mean_over_periods_gives_half_to_all_arms_and_half_to_single_ones():
    factors = np.log([[1.0, 2.0, 4.0, 6.0], [3.0, 4.0, 8.0, 12.0]])
    scan = periods.PeriodScan(np.array([1.0, 2.0]), factors)
    assert scan.log_mean == pytest.approx(np.log(0.5 * 2.0 + 0.5 * (3.0 + 6.0 + 9.0) / 3.0))


def test_usual_ripples_of_rails_are_lengths():
    assert periods.ripple_tolerance(model_of("linear-delta", "offsets")) == 0.02
    assert periods.ripple_tolerance(MODEL) == 20 * ARCSEC
    rails = model_of("linear-delta", "offsets", "lengths")
    rates = periods.scan_periods(fit_model(rails, observed(rails, 12))).rates
    assert 2.0 * np.pi / rates[0] == pytest.approx(80.0)
    assert 3.0 < 2.0 * np.pi / rates[-1] < 3.1


def test_a_ripple_of_one_arm_is_found_with_its_rate_and_amplitude():
    observations = observed(MODEL, 60)
    joints = observations.joints.copy()
    joints[:, 1] -= 5e-4 * np.sin(100.0 * joints[:, 1])
    fit = events.explain(STAND, replace(observations, joints=joints))
    (ripple,) = (effect for effect in fit.model.effects if isinstance(effect, Ripple))
    assert ripple.arms == (1,)
    assert ripple.rate == pytest.approx(100.0, abs=0.3)
    step = np.diff(periods.scan_periods(fit).rates)[0]
    assert ripple.rate_std == pytest.approx(step)
    assert ripple.usual * np.hypot(*ripple.amplitudes) == pytest.approx(5e-4, rel=0.2)
    rates = periods.scan_periods(fit).rates
    assert ripple.log_odds == pytest.approx(-np.log(2.0 * 3.0 * len(rates)))
    assert events.events_of(fit) == ()


def test_a_ripple_of_all_arms_is_one_ripple():
    observations = observed(MODEL, 60)
    joints = observations.joints - 3e-4 * np.cos(60.0 * observations.joints)
    fit = events.explain(STAND, replace(observations, joints=joints))
    ripples = [effect for effect in fit.model.effects if isinstance(effect, Ripple)]
    assert [ripple.arms for ripple in ripples] == [(0, 1, 2)]
    assert ripples[0].rate == pytest.approx(60.0, abs=0.3)
    assert ripples[0].log_odds == pytest.approx(-np.log(2.0 * len(periods.scan_periods(fit).rates)))


def rippled(arms, rad, rate, shots=60):
    """Observations of the robot whose encoders ripple."""
    observations = observed(MODEL, shots)
    joints = observations.joints.copy()
    for arm in arms:
        joints[:, arm] -= rad * np.sin(rate * joints[:, arm] + 0.4)
    return replace(observations, joints=joints)


def test_periods_that_were_found_become_the_robots_own_with_amplitudes_and_a_rate_error():
    found = events.explain(STAND, rippled((1,), 5e-4, 100.0))
    (ripple,) = (effect for effect in found.model.effects if isinstance(effect, Ripple))
    own = periods.with_periods_of_robot(found)
    (error,) = (effect for effect in own.model.effects if isinstance(effect, RateError))
    rates = own.model.nominal.mechanism.rates
    assert [rate == 0.0 for rate in rates] == [True, False, True]
    assert rates[1] == pytest.approx(100.0, abs=0.2)
    assert (error.arms, error.ripple_log_odds) == ((1,), ripple.log_odds)
    places = periods.places_of_ripples(own.model, (1,))
    amplitudes = own.x[places] * own.model.tolerance[places]
    assert amplitudes == pytest.approx(5e-4 * np.array([np.cos(0.4), np.sin(0.4)]), abs=4e-5)
    assert error.amplitudes == pytest.approx(amplitudes, rel=0.05, abs=1e-5)
    assert np.abs(own.at.residual - found.at.residual).max() < 0.02
    assert periods.with_periods_of_robot(own).model.nominal.mechanism.rates[1] == pytest.approx(
        rates[1], rel=1e-3
    )


def test_a_robot_without_ripples_has_no_likely_one_and_a_likely_one_is_on_the_peak():
    clean = fit_model(STAND, observed(MODEL, 40))
    assert not any(periods.likely_ripples(clean))
    fit = fit_model(STAND, rippled((0,), 2e-4, 55.5))
    (ripple,) = periods.likely_ripples(fit)
    assert ripple.arms == (0,)
    assert ripple.rate == pytest.approx(55.5, abs=0.35 * ripple.rate_std)
    assert ripple.usual == 20 * ARCSEC
    assert ripple.amplitudes == ()


def test_a_retuned_fit_keeps_the_sizes_of_ripples_and_counts_the_step_of_their_rate_once():
    ripple = Ripple((1,), 98.7, 2.0, 20 * ARCSEC, -3.0)  # near 49, and after the step near 50
    first = fit_model(STAND.with_effects((Walk(0), ripple)), rippled((1,), 5e-4, 100.0))
    with_rate = events._retuned(first)  # without amplitudes the rate has no column
    fit = settle(with_rate, with_rate.model)
    tuned = events._retuned(fit)
    (found,) = (effect for effect in tuned.model.effects if isinstance(effect, Ripple))
    assert found.rate == pytest.approx(98.7 + 2.0 * fit.at.x[-1])
    assert found.name != ripple.name
    assert tuned.sizes[found.name] == fit.sizes[ripple.name]
    assert tuned.at.x[-1] == 0.0
    assert tuned.at.x[:-1].tolist() == fit.at.x[:-1].tolist()
    again = settle(tuned, tuned.model)
    assert again.model.effects[-1].rate + 2.0 * again.at.x[-1] == pytest.approx(100.0, abs=0.3)
    assert log_evidence(again) > log_evidence(first)


def test_a_fit_without_periods_stays_as_it_is(noisy):
    assert periods.with_periods_of_robot(noisy) is noisy


def test_a_rate_error_is_the_change_of_its_waves_by_the_rate():
    observations = observed(MODEL, 8)
    error = RateError((0, 2), 40.0, 0.5, (3e-4, -1e-4, 2e-4, 5e-4), -3.0)
    basis = error.basis(observations)
    assert not basis[:, 1].any()
    for arm, (sine, cosine) in ((0, (3e-4, -1e-4)), (2, (2e-4, 5e-4))):
        q = observations.joints[:, arm]
        ends = [sine * np.sin(r * q) + cosine * np.cos(r * q) for r in (40.001, 39.999)]
        assert basis[:, arm, 0] == pytest.approx(
            (ends[0] - ends[1]) / 0.002 * 0.5, rel=1e-4, abs=1e-12
        )
    assert (error.sizes_of, error.count, error.moves) == ((("", 1),), 1, "joints")
    changed = MODEL.with_effects((error,))
    x = np.zeros(changed.size)
    at = changed.predict(x, (FRAME,), observations, observations.near)
    assert at.jacobian[..., len(MODEL.names)] == pytest.approx(
        at.columns_of(error, observations)[..., 0]
    )


def test_rates_in_robot_files_are_periods_a_turn_or_mm():
    assert periods.rate_in_file(40.0, is_revolute=True) == 40.0
    assert periods.rate_in_file(2.0 * np.pi / 5.0, is_revolute=False) == pytest.approx(5.0)
