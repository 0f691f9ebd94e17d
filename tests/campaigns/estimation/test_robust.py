import numpy as np
import pytest
from par4_space import SPACE, par4, par4_of, turning_limits

from campaigns.design.pose_sampling import FeasibleRegion, interior_poses
from campaigns.estimation.least_squares import LeastSquaresProblem, Priors, solve
from campaigns.estimation.residuals import DistanceResiduals, PointResiduals, PositionModel
from campaigns.estimation.robust import reject_outliers, rejection_threshold, robust_scale
from campaigns.robots.robot import find_robot

NOISE_MM = 0.015 / 3**0.5
FREE = SPACE.places(SPACE.free_by_default)
NOMINAL = par4(dict(find_robot("par4-prototype").robot.parameters))


@pytest.fixture(scope="module")
def shots():
    """Joints (120, 4), exact points (120, 3) and the true free parameters of an erroneous robot."""
    rng = np.random.default_rng(5)
    errors = rng.normal(0.0, 1.0, len(FREE)) * np.where(
        SPACE.file_unit[FREE] == 1.0, 0.5, np.radians(0.1)
    )
    vector = NOMINAL.p.copy()
    vector[FREE] += errors
    truth = par4_of(vector)
    turn = (-np.pi / 4, np.pi / 4)
    limits = turning_limits((np.radians(-45.0), np.radians(90.0)), turn, np.pi / 4)
    facing = np.array([1.0, 0.0, 0.0])
    centre = np.array([0.0, 0.0, -575.0, 0.0])
    region = FeasibleRegion(
        truth, limits, centre, np.array([3000.0, 0.0, -575.0]), facing, np.pi / 2
    )
    poses = interior_poses(region, 120, rng)
    return truth.inverse(poses).values_or_raise(), poses[:, :3], vector[FREE]


def points_problem(shots, moved=(), noise_mm=NOISE_MM, seed=11, priors=None, off_mm=2.0):
    joints, exact, _ = shots
    rng = np.random.default_rng(seed)
    measured = exact + rng.normal(0.0, noise_mm, exact.shape)
    for shot in moved:
        direction = rng.normal(size=3)
        measured[shot] += off_mm * direction / np.linalg.norm(direction)
    covariance = np.broadcast_to(np.eye(3) * NOISE_MM**2, (len(exact), 3, 3))
    model = PositionModel(NOMINAL, FREE, joints)
    data = PointResiduals.from_points(model, measured, covariance)
    return LeastSquaresProblem(data, 3, priors or Priors.none())


def distances_problem(shots, noise_mm=NOISE_MM, seed=3, wrong=()):
    joints, exact, _ = shots
    first, second = np.arange(0, 120, 2), np.arange(1, 120, 2)
    measured = np.linalg.norm(exact[first] - exact[second], axis=1)
    measured += np.random.default_rng(seed).normal(0.0, noise_mm * 2**0.5, len(measured))
    measured[list(wrong)] += 2.0
    model = PositionModel(NOMINAL, FREE, joints)
    whitening = np.full(len(first), 1.0 / (2.0**0.5 * NOISE_MM))
    data = DistanceResiduals(model, first, second, measured, whitening)
    return LeastSquaresProblem(data, 1, Priors.none())


def worst_mm_deg(x, shots):
    return np.abs((x[: len(FREE)] - shots[2]) / SPACE.file_unit[FREE]).max()


def test_moved_shots_are_named_and_nothing_else_unless_they_are_half_of_all(shots):
    found = reject_outliers(points_problem(shots, (7, 50, 99)))
    assert [outlier[0] for outlier in found.outliers] == [7, 50, 99]
    assert all(outlier[1] > 100.0 > outlier[2] for outlier in found.outliers)
    assert np.flatnonzero(~found.kept).tolist() == [7, 50, 99]
    found = reject_outliers(points_problem(shots))
    assert found.kept.all()
    assert found.outliers == ()
    found = reject_outliers(points_problem(shots, range(0, 120, 2)))
    assert found.kept.all()
    found = reject_outliers(distances_problem(shots, wrong=[17]))
    assert [outlier[0] for outlier in found.outliers] == [17]


def test_answers_without_outliers_are_as_good_as_clean_ones_and_count_all_evaluations(shots):
    clean, spoilt = points_problem(shots), points_problem(shots, (7, 50, 99))
    kept = reject_outliers(spoilt).kept
    without = solve(spoilt.weighted(kept.astype(float))).x
    assert worst_mm_deg(without, shots) <= 1.3 * worst_mm_deg(
        solve(clean.weighted(np.ones(120))).x, shots
    )
    plain = solve(points_problem(shots, (7,)).weighted(np.ones(len(shots[0]))))
    found = reject_outliers(points_problem(shots, (7,))).fit
    assert found.evaluations > plain.evaluations
    assert f"after {found.evaluations} evaluations" in found.message


def test_scatter_that_the_tracker_did_not_state_makes_no_outliers(shots):
    """A robot that repeats thirty times worse than the tracker measures: few degrees of freedom."""
    assert reject_outliers(distances_problem(shots, 30.0 * NOISE_MM)).outliers == ()
    assert reject_outliers(points_problem(shots, (), 30.0 * NOISE_MM)).outliers == ()


class LinearProblem:
    """Residuals r + J x."""

    def __init__(self, jacobian, residual):
        self._jacobian, self._residual, self.rows = jacobian, residual, len(residual)

    def start(self):
        return np.zeros(self._jacobian.shape[1])

    def fine_unknowns(self):
        return np.zeros(self._jacobian.shape[1], dtype=bool)

    def residual(self, x):
        return self._residual + self._jacobian @ x

    def jacobian(self, x):
        return self._jacobian


def test_a_block_that_came_back_does_not_go_again():
    """Beside the others it agrees, in a fit with them it does not: close to the limit of both."""
    rng = np.random.default_rng(1244)
    jacobian, residual = rng.standard_normal((120, 5)), rng.standard_normal(120)
    residual[0] += rng.uniform(3, 7)
    residual[4] += rng.uniform(3, 6)
    problem = LeastSquaresProblem(LinearProblem(jacobian, residual), 3, Priors.none())
    assert reject_outliers(problem).kept.all()


def test_an_outliers_size_is_what_the_fit_of_the_others_leaves_of_it_in_its_own_deviation(shots):
    """Variance of its measurement and of the others' prediction, by the explicit inverse."""
    problem = distances_problem(shots, wrong=[17], noise_mm=10.0 * NOISE_MM)
    (outlier,) = reject_outliers(problem).outliers
    others = np.arange(60) != 17
    fit = solve(problem.weighted(others.astype(float)))
    residual, jacobian = problem.data.residual(fit.x), problem.data.jacobian(fit.x)
    unit = np.sqrt(np.sum(residual[others] ** 2) / (59 - 22))
    known = np.linalg.inv(jacobian[others].T @ jacobian[others])
    own = unit * np.sqrt(1.0 + jacobian[17] @ known @ jacobian[17])
    assert outlier[1] == pytest.approx(abs(residual[17]) / own, rel=1e-3)


def test_scale_of_good_blocks_is_one_and_they_rarely_lose_one():
    draws = np.random.default_rng(1).normal(size=(4000, 3))
    assert robust_scale(np.linalg.norm(draws, axis=1), 3, 0) == pytest.approx(1.0, abs=0.03)
    rng = np.random.default_rng(2)
    limit = rejection_threshold(120, 3)
    worst = np.linalg.norm(rng.normal(size=(2000, 120, 3)), axis=2).max(axis=1)
    assert 0.003 < np.mean(worst > limit) < 0.02
