"""What shots tell so far, against the covariance of a fit that knows nothing of it."""

import numpy as np
import pytest
from par4_cases import NOMINAL, TABLE1, measured_points, reachable_joints
from par4_space import SPACE

from campaigns.estimation import information
from campaigns.estimation.estimate import estimate
from campaigns.estimation.least_squares import LeastSquaresProblem, Priors, solve
from campaigns.estimation.residuals import PointResiduals, PositionModel

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


def fitted(shots, measured_mm):
    """Standard deviations as stated, and the scatter, of a fit of these shots alone."""
    model = PositionModel(NOMINAL, FREE, JOINTS[:shots])
    return judged(solve(PointResiduals.from_points(model, measured_mm[:shots], stated(shots))))


def judged(fit):
    dof = len(fit.residual) - len(fit.x)
    covariance = np.linalg.inv(fit.jacobian.T @ fit.jacobian)[:COUNT, :COUNT]
    return np.sqrt(np.diag(covariance)), np.sqrt(fit.residual @ fit.residual / dof)


@pytest.mark.parametrize("scatter", [0.5, 5.0])
def test_stated_noise_counts_as_a_prior_on_the_scatter_of_distances_until_it_is_refuted(scatter):
    tested = information.chi_square_test(18 * scatter**2, 18)
    sigma0 = information.variance_scale(scatter, tested, known_variance=False)
    pooled = (information.STATED_DOF + 18 * scatter**2) / (information.STATED_DOF + 18)
    assert sigma0 == pytest.approx(pooled**0.5 if tested.consistent else scatter)
    assert tested.consistent == (scatter == 0.5)


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
    told = fitted_to_the_end(measured_mm)
    assert told.noise.birge_ratio < 1.3
    assert std_of_parameters(told).max() < 1.3 * fitted(SHOTS, points_mm())[0].max()
