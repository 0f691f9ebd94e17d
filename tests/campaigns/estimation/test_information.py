"""What shots tell so far, against the covariance of a fit that knows nothing of it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from par4_cases import NOMINAL, TABLE1, measured_points, reachable_joints
from par4_space import SPACE

from campaigns.estimation import information
from campaigns.estimation.estimate import estimate
from campaigns.estimation.incremental_fit import PRIOR_LENGTH_MM, IncrementalGaussNewton
from campaigns.estimation.least_squares import LeastSquaresProblem, Priors, solve
from campaigns.estimation.residuals import DistanceResiduals, PointResiduals, PositionModel

SHOTS = 80
FREE = SPACE.places(SPACE.free_by_default)
COUNT = len(FREE)
JOINTS = reachable_joints(TABLE1, SHOTS, seed=31)
BEAM_STD_MM, ACROSS_STD_MM = 0.004, 0.012
COVARIANCE_MM2 = np.diag([BEAM_STD_MM, ACROSS_STD_MM, ACROSS_STD_MM]) ** 2
PAIRS = np.arange(SHOTS).reshape(-1, 2)


def stated(shots):
    return np.broadcast_to(COVARIANCE_MM2, (shots, 3, 3))


def points_mm(scatter=1.0, seed=5):
    noise = np.random.default_rng(seed).standard_normal((SHOTS, 3))
    return measured_points(TABLE1, JOINTS) + scatter * noise * np.sqrt(np.diag(COVARIANCE_MM2))


def seen_after(shots, measured_mm):
    return _seen(measured_mm[:shots].tobytes())


@cache
def _seen(measured):
    running = IncrementalGaussNewton(NOMINAL, SPACE.free_by_default)
    for joints, point_mm in zip(JOINTS, np.frombuffer(measured).reshape(-1, 3), strict=False):
        running.add(joints, point_mm)
    return running.linearized(SPACE.free_by_default)


def fitted(shots, measured_mm):
    """Standard deviations as stated, and the scatter, of a fit of these shots alone."""
    model = PositionModel(NOMINAL, FREE, JOINTS[:shots])
    return judged(solve(PointResiduals.from_points(model, measured_mm[:shots], stated(shots))))


def judged(fit):
    dof = len(fit.residual) - len(fit.x)
    covariance = np.linalg.inv(fit.jacobian.T @ fit.jacobian)[:COUNT, :COUNT]
    return np.sqrt(np.diag(covariance)), np.sqrt(fit.residual @ fit.residual / dof)


def told_by_points(shots, measured_mm, covariance_mm2=None):
    """σ of the parameters, and the test of the noise."""
    covariance = stated(shots) if covariance_mm2 is None else covariance_mm2
    found = information.covariance_from_points(
        replace(seen_after(shots, measured_mm), stated_mm2=covariance)
    )
    return None if found is None else (std_of(found[0]), found[1])


def told_by_distances(measured_mm, pairs=PAIRS):
    seen = replace(seen_after(SHOTS, measured_mm), stated_mm2=stated(SHOTS))
    found = information.covariance_from_distances(seen, measured_mm, pairs)
    return None if found is None else (std_of(found[0]), found[1])


def std_of(covariance):
    return np.sqrt(np.diag(covariance))


@pytest.mark.parametrize("shots", [20, 80])
def test_points_tell_what_a_fit_of_them_alone_would(shots):
    measured_mm = points_mm()
    std, noise = told_by_points(shots, measured_mm)
    as_stated, scatter = fitted(shots, measured_mm)
    np.testing.assert_allclose(noise.birge_ratio, scatter, rtol=1e-3)
    np.testing.assert_allclose(std, as_stated, rtol=5e-3)


def test_scatter_changes_deviations_only_beyond_chance():
    measured_mm = points_mm(1.15)
    _, noise = told_by_points(SHOTS, measured_mm)
    assert noise.birge_ratio > 1.05
    assert noise.sigma0 == 1.0
    scatter = 5.0
    measured_mm = points_mm(scatter)
    std, noise = told_by_points(SHOTS, measured_mm)
    assert noise.birge_ratio == pytest.approx(scatter, rel=0.2)
    as_stated, found = fitted(SHOTS, measured_mm)
    np.testing.assert_allclose(std, as_stated * found, rtol=0.02)
    exact, noisy = points_mm(0.0), points_mm(0.5)
    (still, none), (quiet, some) = (told_by_points(SHOTS, each) for each in (exact, noisy))
    assert none.birge_ratio < 0.01
    assert some.birge_ratio == pytest.approx(0.5, rel=0.2)
    np.testing.assert_allclose(still, quiet, rtol=1e-3)
    np.testing.assert_allclose(still, fitted(SHOTS, exact)[0], rtol=1e-3)


@pytest.mark.parametrize("scatter", [5.0, 0.1])
def test_distances_are_as_sure_as_their_own_scatter_says(scatter):
    """Whether that is more or less than stated, when it cannot be as stated."""
    _, told = told_by_distances(points_mm(scatter))
    assert told.sigma0 == told.birge_ratio == pytest.approx(scatter, rel=0.3)


def test_stated_noise_counts_as_a_prior_on_the_scatter_of_distances():
    _, told = told_by_distances(points_mm(0.5))
    dof = len(PAIRS) - COUNT
    pooled = (information.STATED_DOF + dof * told.birge_ratio**2) / (information.STATED_DOF + dof)
    assert told.sigma0 == pytest.approx(pooled**0.5)
    assert abs(told.sigma0 - 1.0) < abs(told.birge_ratio - 1.0)


def test_variance_is_known_by_its_residuals_and_by_what_is_stated_and_not_without_either():
    believed, refuted = (
        information.chi_square_test(4.0, 4, 1.0),
        information.chi_square_test(40.0, 4, 10.0**0.5),
    )
    assert information.variance_dof(believed, known_variance=True) is None
    assert information.variance_dof(believed, known_variance=False) == 4 + information.STATED_DOF
    assert information.variance_dof(refuted, known_variance=False) == 4
    assert information.variance_dof(refuted, known_variance=True) == 4
    assert (
        information.variance_scale(None, information.chi_square_test(0.0, 0), known_variance=False)
        is None
    )


def test_nothing_of_the_running_fits_priors_is_in_it():
    """With few shots its priors of 5 mm would make σ of centimetres look like millimetres."""
    shots = 14
    measured_mm = points_mm(0.0)
    huge = 1e4 * stated(shots)
    std, _ = told_by_points(shots, measured_mm, huge)
    assert std.max() > 3.0 * PRIOR_LENGTH_MM


def test_too_few_shots_no_pairs_and_a_covariance_that_cannot_be_tell_nothing():
    measured_mm = points_mm()
    fewest = -(-(COUNT + 6 + information.MINIMUM_DOF) // 3)
    assert told_by_points(fewest - 1, measured_mm) is None
    assert told_by_points(fewest, measured_mm) is not None
    broken = stated(SHOTS).copy()
    broken[7] = np.diag([1e-4, -1e-4, 1e-4])
    assert told_by_points(SHOTS, points_mm(), broken) is None
    assert told_by_distances(points_mm(), np.empty((0, 2), dtype=np.intp)) is None


def test_shots_that_cannot_tell_all_parameters_tell_nothing():
    """Ten poses, each of them seen four times."""
    joints, measured_mm = np.repeat(JOINTS[:10], 4, axis=0), np.repeat(points_mm()[:10], 4, axis=0)
    running = IncrementalGaussNewton(NOMINAL, SPACE.free_by_default)
    for joint, point_mm in zip(joints[:36], measured_mm[:36], strict=True):
        running.add(joint, point_mm)
    seen = running.linearized(SPACE.free_by_default)
    assert information.covariance_from_points(replace(seen, stated_mm2=stated(36))) is None


def test_distances_tell_what_a_fit_of_them_alone_would():
    measured_mm = points_mm(2.0)
    std, _ = told_by_distances(measured_mm)
    first, second = PAIRS.T
    lengths = np.linalg.norm(measured_mm[second] - measured_mm[first], axis=1)
    model = PositionModel(NOMINAL, FREE, JOINTS)
    by_mm, spread_mm = judged(solve(DistanceResiduals.in_mm(model, first, second, lengths)))
    np.testing.assert_allclose(std, by_mm * spread_mm, rtol=0.02)


def problem(measured_mm, shots=SHOTS):
    model = PositionModel(NOMINAL, FREE, JOINTS[:shots])
    points = PointResiduals.from_points(model, measured_mm[:shots], stated(shots))
    return LeastSquaresProblem(points, 3, Priors.none())


def fitted_to_the_end(measured_mm):
    return estimate(problem(measured_mm), COUNT, known_variance=True)


def std_of_parameters(found):
    return np.sqrt(np.diag(found.covariance))[:COUNT]


def test_a_fit_to_the_end_leaves_outliers_out():
    """One shot 2 mm aside makes all the others look a hundred times worse; not so here."""
    measured_mm = points_mm()
    measured_mm[17, 1] += 2.0
    _, at_once = told_by_points(SHOTS, measured_mm)
    told = fitted_to_the_end(measured_mm)
    assert at_once.birge_ratio > 5.0
    assert told.noise.birge_ratio < 1.3
    assert std_of_parameters(told).max() < 1.3 * fitted(SHOTS, points_mm())[0].max()
