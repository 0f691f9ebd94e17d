"""What a plan tells in advance, against the formula written out."""

import numpy as np
import pytest
from par4_cases import NOMINAL, central_differences, reachable_joints
from par4_space import FREE_BY_DEFAULT, IS_ANGLE, NAMES, indices, par4_of

from campaigns.estimation.information import predict_distances
from campaigns.estimation.observability import observability_indices

FREE = indices(FREE_BY_DEFAULT)
JOINTS = reachable_joints(NOMINAL, 120, seed=61)
POSES = NOMINAL.forward(JOINTS).values_or_raise()
PAIRS = np.arange(120).reshape(-1, 2)
VARIANCE_MM2 = np.random.default_rng(1).uniform(5e-5, 2e-4, 60)


def distances_mm(free_values):
    vector = NOMINAL.p.copy()
    vector[FREE] = free_values
    positions = par4_of(vector).forward(JOINTS, POSES).values_or_raise()[:, :3]
    return np.linalg.norm(positions[PAIRS[:, 1]] - positions[PAIRS[:, 0]], axis=1)


def test_standard_deviations_are_those_of_weighted_least_squares():
    steps = np.where(IS_ANGLE[FREE], 1e-5, 1e-3)
    jacobian = central_differences(distances_mm, NOMINAL.p[FREE], steps)
    information = jacobian.T @ np.diag(1.0 / VARIANCE_MM2) @ jacobian
    expected = np.sqrt(np.diag(np.linalg.inv(information)))
    told = predict_distances(NOMINAL, FREE_BY_DEFAULT, JOINTS, POSES, PAIRS, VARIANCE_MM2)
    assert told.rank == 22
    assert told.std == pytest.approx(expected, rel=1e-5)


def test_sixty_pairs_at_a_tracker_s_noise_give_tenths_of_a_millimetre():
    """Random pairs at 0.015/√3 mm a coordinate: 0.09 mm and 0.007° for the worst parameters."""
    variance_mm2 = np.full(60, 2.0 * 0.015**2 / 3.0)
    told = predict_distances(NOMINAL, FREE_BY_DEFAULT, JOINTS, POSES, PAIRS, variance_mm2)
    assert 0.05 < told.std[~IS_ANGLE[FREE]].max() < 0.18
    assert 0.003 < np.degrees(told.std[IS_ANGLE[FREE]].max()) < 0.014


def test_four_times_the_variance_doubles_every_standard_deviation():
    plain, noisy = (
        predict_distances(NOMINAL, FREE_BY_DEFAULT, JOINTS, POSES, PAIRS, factor * VARIANCE_MM2)
        for factor in (1.0, 4.0)
    )
    assert noisy.std == pytest.approx(2.0 * plain.std, rel=1e-9)
    assert noisy.condition == pytest.approx(plain.condition, rel=1e-9)


def test_lost_rank_predicts_infinite_standard_deviations():
    told = predict_distances(NOMINAL, NAMES, JOINTS, POSES, PAIRS, VARIANCE_MM2)
    assert told.rank == 25
    assert told.condition == np.inf
    assert np.isinf(told.std).all()
    assert told.indices["O2"] < 1e-12


def test_observability_indices_of_known_singular_values():
    """Singular values 8, 4, 2, 1 of 16 rows."""
    told = observability_indices(np.array([8.0, 4.0, 2.0, 1.0]), 16)
    assert told["O1"] == pytest.approx(64.0**0.25 / 4.0)
    assert told["O2"] == pytest.approx(1.0 / 8.0)
    assert told["O3"] == pytest.approx(1.0)
    assert told["O4"] == pytest.approx(1.0 / 8.0)
    assert told["O5"] == pytest.approx(1.0 / (1.0 / 8.0 + 1.0 / 4.0 + 1.0 / 2.0 + 1.0))


def test_observability_indices_vanish_with_a_singular_value():
    told = observability_indices(np.array([8.0, 1.0, 0.0]), 9)
    assert set(told.values()) == {0.0}
