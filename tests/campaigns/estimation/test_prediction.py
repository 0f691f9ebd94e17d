"""What distances and coordinates will tell, against the formula written out and fits."""

from dataclasses import replace

import numpy as np
import pytest
from design_cases import VARIANCE_MM2 as ISOTROPIC_MM2
from design_cases import drawn, isotropic, rows_at
from par4_cases import NOMINAL, central_differences, measured_points, reachable_joints
from par4_space import SPACE, par4_of

from campaigns.estimation.information import (
    marginalise_frame,
    position_std_mm,
    predict_distances,
    predict_points,
)
from campaigns.estimation.least_squares import solve
from campaigns.estimation.observability import observability
from campaigns.estimation.residuals import PointResiduals, PositionModel
from campaigns.estimation.rigid_transforms import fit_transform

FREE = SPACE.places(SPACE.free_by_default)
JOINTS = reachable_joints(NOMINAL, 120, seed=61)
POSES = NOMINAL.forward(JOINTS).values_or_raise()
SHOTS = 60
PAIRS = np.arange(120).reshape(-1, 2)
VARIANCE_MM2 = np.random.default_rng(1).uniform(5e-5, 2e-4, 60)


def distances_mm(free_values):
    vector = NOMINAL.p.copy()
    vector[FREE] = free_values
    positions = par4_of(vector).forward(JOINTS, POSES).values_or_raise()[:, :3]
    return np.linalg.norm(positions[PAIRS[:, 1]] - positions[PAIRS[:, 0]], axis=1)


def told(variance_mm2=VARIANCE_MM2, names=SPACE.free_by_default):
    found, seen = predict_distances(NOMINAL, names, JOINTS, POSES, PAIRS, variance_mm2)
    return np.sqrt(np.diag(found)), seen


def test_standard_deviations_are_those_of_weighted_least_squares():
    steps = np.where(SPACE.is_angle[FREE], 1e-5, 1e-3)
    jacobian = central_differences(distances_mm, NOMINAL.p[FREE], steps)
    information = jacobian.T @ np.diag(1.0 / VARIANCE_MM2) @ jacobian
    expected = np.sqrt(np.diag(np.linalg.inv(information)))
    std, seen = told()
    assert seen.rank == 22
    assert std == pytest.approx(expected, rel=1e-5)


def test_variance_scales_and_sixty_pairs_give_tenths_of_a_millimetre():
    """Random pairs at 0.015/√3 mm a coordinate: 0.09 mm and 0.007° for the worst parameters."""
    variance_mm2 = np.full(60, 2.0 * 0.015**2 / 3.0)
    std, _ = told(variance_mm2)
    assert 0.05 < std[~SPACE.is_angle[FREE]].max() < 0.18
    assert 0.003 < np.degrees(std[SPACE.is_angle[FREE]].max()) < 0.014
    (plain, seen), (noisy, same) = (told(factor * VARIANCE_MM2) for factor in (1.0, 4.0))
    assert noisy == pytest.approx(2.0 * plain, rel=1e-9)
    assert same.condition == pytest.approx(seen.condition, rel=1e-9)


def test_lost_rank_predicts_infinite_standard_deviations():
    std, seen = told(names=SPACE.names)
    assert seen.rank == 25
    assert seen.condition == np.inf
    assert np.isinf(std).all()
    assert seen.indices["O2"] < 1e-12


def indices_of(singular_values, rows):
    seen = observability(np.eye(len(singular_values)))
    return replace(seen, singular_values=np.array(singular_values), rows=rows).indices


def test_observability_indices_are_those_of_singular_values_and_vanish_with_one():
    """Singular values 8, 4, 2, 1 of 16 rows."""
    told = indices_of([8.0, 4.0, 2.0, 1.0], 16)
    assert told["O1"] == pytest.approx(64.0**0.25 / 4.0)
    assert told["O2"] == pytest.approx(1.0 / 8.0)
    assert told["O3"] == pytest.approx(1.0)
    assert told["O4"] == pytest.approx(1.0 / 8.0)
    assert told["O5"] == pytest.approx(1.0 / (1.0 / 8.0 + 1.0 / 4.0 + 1.0 / 2.0 + 1.0))
    told = indices_of([8.0, 1.0, 0.0], 9)
    assert set(told.values()) == {0.0}


@pytest.fixture(scope="module")
def poses():
    return drawn(SHOTS, 8)[0]


@pytest.fixture(scope="module")
def joints(poses):
    return NOMINAL.inverse(poses).values_or_raise()


@pytest.fixture(scope="module")
def known(poses, joints):
    return predict_points(NOMINAL, SPACE.free_by_default, joints, poses, isotropic(SHOTS))[0]


def test_prediction_is_the_covariance_of_the_fit_itself(poses, joints, known):
    """From the residuals that the estimator solves, in another frame and from other code."""
    points = measured_points(NOMINAL, joints)
    model = PositionModel(NOMINAL, FREE, joints)
    fit = solve(PointResiduals.from_points(model, points, isotropic(SHOTS)))
    of_fit = np.linalg.inv(fit.jacobian.T @ fit.jacobian)
    count = len(FREE)
    np.testing.assert_allclose(known[:count, :count], of_fit[:count, :count], rtol=1e-4, atol=1e-12)


def test_what_is_seen_is_of_the_parameters_alone_and_lost_rank_gives_infinite_deviations(
    poses, joints
):
    _, seen = predict_points(NOMINAL, SPACE.free_by_default, joints, poses, isotropic(SHOTS))
    assert seen.rank == 22
    assert 10 < seen.condition < 1000
    assert all(value > 0.0 for value in seen.indices.values())
    found, seen = predict_points(
        NOMINAL, SPACE.free_by_default, joints[:11], poses[:11], isotropic(11)
    )
    assert seen.rank < 22
    assert np.isinf(found).all()


def test_error_without_frame_is_what_the_best_fit_of_a_frame_leaves(poses, known):
    """One change of the parameters, by the forward model and by the rows."""
    there = NOMINAL.inverse(poses).values_or_raise()
    change = (
        1e-4 * np.random.default_rng(2).standard_normal(len(FREE)) * np.sqrt(np.diag(known)[:22])
    )
    vector = NOMINAL.p.copy()
    vector[FREE] += change
    moved = par4_of(vector).forward(there, poses).values_or_raise()[:, :3]
    left = fit_transform(moved, poses[:, :3]).apply(moved) - poses[:, :3]
    rows = marginalise_frame(rows_at(poses))
    np.testing.assert_allclose(rows @ change, left, atol=1e-3 * np.abs(left).max())
    size = position_std_mm(rows, np.outer(change, change))
    np.testing.assert_allclose(size, np.linalg.norm(left, axis=1), rtol=0.02, atol=1e-10)


def test_mean_information_bounds_the_mean_error_at_the_shots(poses, known):
    """The variances at the shots themselves sum to one a parameter: P times the noise's."""
    size = position_std_mm(rows_at(poses), known)
    assert np.sum(size**2) == pytest.approx(28 * ISOTROPIC_MM2)
