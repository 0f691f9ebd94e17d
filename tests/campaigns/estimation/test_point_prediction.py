"""What coordinates will tell: parameters, and positions anywhere."""

import numpy as np
import pytest
from design_cases import VARIANCE_MM2, drawn, isotropic, rows_at
from par4_cases import NOMINAL, TRACKER_STD_MM, measured_points
from par4_space import FREE_BY_DEFAULT, indices, par4_of

from campaigns.estimation.information import (
    marginalise_frame,
    position_std_mm,
    predict_points,
)
from campaigns.estimation.least_squares import solve
from campaigns.estimation.residuals import PointResiduals, PositionModel
from campaigns.estimation.rigid_transforms import fit_transform

SHOTS = 60
FREE = indices(FREE_BY_DEFAULT)


@pytest.fixture(scope="module")
def poses():
    return drawn(SHOTS, 8)[0]


@pytest.fixture(scope="module")
def joints(poses):
    return NOMINAL.inverse(poses).values_or_raise()


@pytest.fixture(scope="module")
def known(poses, joints):
    return predict_points(NOMINAL, FREE_BY_DEFAULT, joints, poses, isotropic(SHOTS))[0]


def test_prediction_is_the_covariance_of_the_fit_itself(poses, joints, known):
    """From the residuals that the estimator solves, in another frame and from other code."""
    points = measured_points(NOMINAL, joints)
    model = PositionModel(NOMINAL, FREE, joints)
    fit = solve(PointResiduals.from_points(model, points, isotropic(SHOTS)))
    of_fit = np.linalg.inv(fit.jacobian.T @ fit.jacobian)
    count = len(FREE)
    np.testing.assert_allclose(known[:count, :count], of_fit[:count, :count], rtol=1e-4, atol=1e-12)


def test_what_is_seen_is_of_the_parameters_alone(poses, joints):
    _, seen = predict_points(NOMINAL, FREE_BY_DEFAULT, joints, poses, isotropic(SHOTS))
    assert seen.rank == 22
    assert 10 < seen.condition < 1000
    assert all(value > 0.0 for value in seen.indices.values())


def test_lost_rank_gives_infinite_deviations(poses, joints):
    found, seen = predict_points(NOMINAL, FREE_BY_DEFAULT, joints[:11], poses[:11], isotropic(11))
    assert seen.rank < 22
    assert np.isinf(found).all()


def test_twice_the_noise_gives_twice_the_deviation(poses, joints):
    one, two = (
        predict_points(NOMINAL, FREE_BY_DEFAULT, joints, poses, factor**2 * isotropic(SHOTS))[0]
        for factor in (1.0, 2.0)
    )
    np.testing.assert_allclose(two, 4.0 * one)


@pytest.mark.slow
def test_predicted_position_error_is_what_fits_of_noisy_shots_show(poses, joints, known):
    """Errors of the positions that 300 noisy campaigns predict in the tracker's frame."""
    elsewhere = drawn(20, 9)[0]
    there = NOMINAL.inverse(elsewhere).values_or_raise()
    predicted = position_std_mm(rows_at(elsewhere), known)
    exact = measured_points(NOMINAL, there)
    errors = []
    for seed in range(300):
        points = measured_points(NOMINAL, joints, TRACKER_STD_MM, seed)
        problem = PointResiduals.from_points(
            PositionModel(NOMINAL, FREE, joints, poses), points, isotropic(SHOTS)
        )
        x = problem.start()
        x = x - np.linalg.lstsq(problem.jacobian(x), problem.residual(x), rcond=None)[0]
        positions = (
            problem.model.kinematics(x[:-6]).forward(there, elsewhere).values_or_raise()[:, :3]
        )
        errors.append(problem.tracker_from_base(x).apply(positions) - exact)
    shown = np.sqrt(np.mean(np.sum(np.square(errors), axis=2), axis=0))
    np.testing.assert_allclose(shown.mean(), predicted.mean(), rtol=0.05)
    np.testing.assert_allclose(shown, predicted, rtol=0.25)


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
    assert np.sum(size**2) == pytest.approx(28 * VARIANCE_MM2)
