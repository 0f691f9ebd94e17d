"""Layers: factors against dense matrices; a bent error is proposed, a clean robot has none."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from small_fits import log_bayes_factor, model_of, observed, with_points

from campaigns.fit import layers
from campaigns.fit.effects import Layer, Walk
from campaigns.fit.fit import fit_model

GROUPS = ("offsets", "lengths", "axes")
MODEL = model_of("delta", *GROUPS)
SIZES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)


def bent(observations, depth_mm):
    """Points that lie lower beyond a kink at x = 0 in the base frame."""
    down = np.maximum(observations.near[:, 0], 0.0) / observations.near[:, 0].max()
    return with_points(
        observations, observations.points - depth_mm * np.outer(down, [0.0, 0.0, 1.0])
    )


@pytest.fixture(scope="module")
def kinked():
    return fit_model(MODEL, bent(observed(MODEL, 40), 0.4))


def log_factor(fit, layer, group, sizes=SIZES):
    """Log mean of the exact factors of one group of a layer, the others absent."""
    others = {name: 1e-7 for name, _ in layer.sizes_of}
    exact = [log_bayes_factor(fit, layer, {**others, group: size}) for size in sizes]
    return np.logaddexp.reduce(exact) - np.log(len(sizes))


@pytest.mark.parametrize("number", [0, 5, -1])
def test_factors_are_those_of_the_linear_model_with_even_odds_for_each_direction(kinked, number):
    layer = layers.candidate_layers(kinked)[number]
    exact = [np.logaddexp(0.0, log_factor(kinked, layer, group)) for group, _ in layer.sizes_of]
    value = layers.log_factors(kinked, [layer])[0] + len(exact) * np.log(2.0)
    # directions whose score is small are dismissed: they count as a factor of 0 or as their own
    choices = product(*((0.0, factor) if factor < 1.5 else (factor,) for factor in exact))
    assert min(abs(value - sum(choice)) for choice in choices) < 1e-3
    assert value > 1.0


def test_a_direction_that_the_score_does_not_dismiss_has_its_exact_factor(kinked):
    layer = layers.candidate_layers(kinked)[1]
    exact = np.array([log_factor(kinked, layer, group) for group, _ in layer.sizes_of])
    surest = exact[exact > 3.0]
    value = layers.log_factors(kinked, [layer])[0] + 3.0 * np.log(2.0)
    assert len(surest) < 3
    assert surest.sum() <= value + 1e-3
    assert value < surest.sum() + np.log1p(np.exp(exact[exact <= 3.0])).sum() + 0.1


def test_a_direction_is_dismissed_below_two_standard_deviations_of_its_score():
    """The score (Σ u² - Σ g) / 2 has the standard deviation √(½ Σ g²), by drawing clean robots."""
    rng = np.random.default_rng(6)
    fit = fit_model(MODEL, observed(MODEL, 20, seed=3))
    layer = layers.candidate_layers(fit)[2]
    kept = 0
    for _ in range(60):
        noise = np.linalg.cholesky(fit.total_noise) @ rng.normal(size=(20, 3, 1))
        drawn = replace(fit, at=replace(fit.at, x=0.0 * fit.at.x, residual=noise[..., 0]))
        value = layers.log_factors(drawn, [layer])[0] + 3.0 * np.log(2.0)
        kept += value > 1e-9
    # of three directions each about 4 % beyond two standard deviations
    assert 1 <= kept <= 16


def test_a_layer_of_a_clean_robot_is_dismissed_by_its_score():
    fit = fit_model(MODEL, observed(MODEL, 40, seed=3))
    values = layers.log_factors(fit, layers.candidate_layers(fit))
    assert np.median(values) <= 0.0
    assert values.min() >= -3.0 * np.log(2.0) - 1e-12
    assert not any(layers.likely_layers(fit))


def test_a_bent_error_is_proposed_with_the_odds_of_the_mean_of_all_layers(kinked):
    candidates = layers.candidate_layers(kinked)
    factors = layers.log_factors(kinked, candidates)
    (layer, *_) = layers.likely_layers(kinked)
    best = candidates[int(factors.argmax())]
    assert layer.kind == "place"
    assert layer.name == best.name
    mean = np.logaddexp.reduce(factors) - np.log(len(factors))
    assert layer.log_odds == pytest.approx(mean - factors.max())


def test_at_most_one_layer_of_each_kind_is_proposed(kinked):
    place = next(layer for layer in layers.candidate_layers(kinked) if layer.kind == "place")
    model = MODEL.with_effects((Walk(0), place))
    fit = fit_model(model, kinked.observations)
    assert all(layer.kind == "arms" for layer in layers.likely_layers(fit))
    arms = next(layer for layer in layers.candidate_layers(kinked) if layer.kind == "arms")
    both = fit_model(MODEL.with_effects((place, arms)), kinked.observations)
    assert not any(layers.likely_layers(both))


def test_an_error_of_an_arms_angle_is_a_layer_of_the_arms():
    observations = observed(MODEL, 50)
    joints = observations.joints.copy()
    middle = np.median(joints[:, 1])
    joints[:, 1] += 2e-3 * np.abs(joints[:, 1] - middle)
    fit = fit_model(MODEL, replace(observations, joints=joints))
    assert next(layers.likely_layers(fit)).kind == "arms"


def test_candidates_have_three_lengths_of_each_set_of_coordinates_and_of_the_angles():
    model = model_of("par4-prototype", "offsets")
    fit = fit_model(model, observed(model, 20))
    usable = np.arange(20) > 1
    candidates = layers.candidate_layers(replace(fit, usable=usable))
    poses = fit.observations.near[usable]
    radius = np.linalg.norm(poses[:, :2] - poses[:, :2].mean(axis=0), axis=1).max()
    places = [layer for layer in candidates if layer.kind == "place"]
    assert [layer.shots[0].shape for layer in places] == [(18, 2), (18, 3), (18, 4)] * 3
    expected = np.repeat([0.25 * radius, 0.5 * radius, radius], 3)
    assert [layer.length for layer in places] == pytest.approx(expected)
    turned = poses * [1.0, 1.0, 1.0, radius / 1.5]
    assert places[2].shots[0] == pytest.approx(turned)
    assert {layer.usual for layer in places} == {0.020}
    arms = [layer for layer in candidates if layer.kind == "arms"]
    span = np.ptp(fit.observations.joints[usable])
    assert [layer.length for layer in arms] == pytest.approx([0.1 * span, 0.25 * span, 0.5 * span])
    assert {layer.usual for layer in arms} == {np.radians(0.01)}
    rails = model_of("linear-delta", "offsets")
    of_rails = layers.candidate_layers(fit_model(rails, observed(rails, 12)))
    assert {layer.usual for layer in of_rails} == {0.020}


def test_shots_left_out_are_judged_with_the_others_once_there_are_two():
    fit = fit_model(MODEL, bent(observed(MODEL, 40), 0.4))
    lowest = np.argsort(-fit.observations.near[:, 0])[:16]
    good = np.ones(40)
    good[lowest] = 0.0
    hidden = replace(fit, good=good)
    proposals = list(layers.likely_layers(hidden))
    whole = list(layers.likely_layers(replace(fit, good=np.ones(40))))
    assert proposals[-1].name == whole[0].name
    one = replace(fit, good=np.r_[0.0, np.ones(39)])
    assert len(list(layers.likely_layers(one))) <= 1
    assert isinstance(proposals[-1], Layer)


def test_of_many_shots_a_part_makes_the_functions_and_the_kink_is_found(kinked, monkeypatch):
    monkeypatch.setattr(layers, "MOST_KNOTS", 25)
    candidates = layers.candidate_layers(kinked)
    assert {len(at) for layer in candidates for at in layer.shots} == {25}
    assert any(layer.kind == "place" for layer in layers.likely_layers(kinked))
