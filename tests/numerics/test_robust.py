import numpy as np
import pytest

from campaigns.numerics.geometry import FILE_UNIT, FREE_BY_DEFAULT, Geometry, indices
from campaigns.numerics.par4 import inverse
from campaigns.numerics.placement import Region, inner_poses
from campaigns.numerics.reach import Limits
from campaigns.numerics.residuals import DistanceResiduals, PointResiduals, PositionModel
from campaigns.numerics.robust import (
    Loss,
    Weighted,
    block_sizes,
    largest_believable,
    loss_weights,
    robust_scale,
    solve_robust,
    solve_without_outliers,
)
from campaigns.robot import find_robot

NOISE_MM = 0.015 / 3**0.5
FREE = indices(FREE_BY_DEFAULT)
NOMINAL = Geometry.from_flat(find_robot("par4-prototype").robot.geometry_flat())


@pytest.fixture(scope="module")
def shots():
    """Joints (120, 4), exact points (120, 3) and the true free parameters of an erroneous robot."""
    rng = np.random.default_rng(5)
    errors = rng.normal(0.0, 1.0, len(FREE)) * np.where(
        FILE_UNIT[FREE] == 1.0, 0.5, np.radians(0.1)
    )
    vector = NOMINAL.vector()
    vector[FREE] += errors
    truth = Geometry.from_vector(vector)
    limits = Limits((np.radians(-45.0), np.radians(90.0)), (-np.pi / 4, np.pi / 4), np.pi / 4)
    facing = np.array([1.0, 0.0, 0.0])
    centre = np.array([0.0, 0.0, -575.0, 0.0])
    region = Region(truth, limits, centre, np.array([3000.0, 0.0, -575.0]), facing, np.pi / 2)
    poses = inner_poses(region, 120, rng)
    return inverse(truth, poses).require(), poses[:, :3], vector[FREE]


def points_problem(shots, moved=()):
    joints, exact, _ = shots
    rng = np.random.default_rng(11)
    measured = exact + rng.normal(0.0, NOISE_MM, exact.shape)
    for shot in moved:
        direction = rng.normal(size=3)
        measured[shot] += 2.0 * direction / np.linalg.norm(direction)
    covariance = np.broadcast_to(np.eye(3) * NOISE_MM**2, (len(exact), 3, 3))
    return PointResiduals.from_points(PositionModel(NOMINAL, FREE, joints), measured, covariance)


def worst_mm_deg(x, shots):
    return np.abs((x[: len(FREE)] - shots[2]) / FILE_UNIT[FREE]).max()


def test_three_moved_shots_are_named_and_nothing_else(shots):
    robust, outliers = solve_without_outliers(points_problem(shots, (7, 50, 99)), 3)
    assert [outlier.block for outlier in outliers] == [7, 50, 99]
    assert all(outlier.size > 100.0 > outlier.limit for outlier in outliers)
    assert np.flatnonzero(robust.weights == 0.0).tolist() == [7, 50, 99]


def test_answer_without_outliers_is_as_good_as_the_clean_one(shots):
    clean, none = solve_without_outliers(points_problem(shots), 3)
    robust, _ = solve_without_outliers(points_problem(shots, (7, 50, 99)), 3)
    assert none == ()
    assert worst_mm_deg(robust.fit.x, shots) <= 1.3 * worst_mm_deg(clean.fit.x, shots)


@pytest.mark.parametrize("loss", [Loss.SOFT_L1, Loss.CAUCHY])
def test_robust_loss_withstands_what_spoils_the_plain_one(shots, loss):
    spoilt = points_problem(shots, (7, 50, 99))
    plain = solve_robust(spoilt, 3, Loss.LINEAR, 3.0)
    robust = solve_robust(spoilt, 3, loss, 3.0)
    assert worst_mm_deg(robust.fit.x, shots) < 0.2 * worst_mm_deg(plain.fit.x, shots)


def test_a_wrong_distance_is_named_too(shots):
    joints, exact, _ = shots
    first, second = np.arange(0, 120, 2), np.arange(1, 120, 2)
    measured = np.linalg.norm(exact[first] - exact[second], axis=1)
    measured += np.random.default_rng(3).normal(0.0, NOISE_MM, len(measured))
    measured[17] += 2.0
    data = DistanceResiduals(PositionModel(NOMINAL, FREE, joints), first, second, measured)
    whitened = Weighted(data, 1, np.full(len(first), (1.0 / (NOISE_MM * 2**0.5)) ** 2))
    _, outliers = solve_without_outliers(whitened, 1)
    assert [outlier.block for outlier in outliers] == [17]


def test_weights_fall_with_the_block_not_with_its_coordinates():
    sizes = block_sizes(np.array([3.0, 4.0, 0.0, 0.0, 0.0, 5.0]), 3)
    assert sizes.tolist() == [5.0, 5.0]
    for loss in Loss:
        first, second = loss_weights(loss, sizes, 1.0)
        assert first == second


def test_scale_of_good_blocks_is_one():
    draws = np.random.default_rng(1).normal(size=(4000, 3))
    assert robust_scale(np.linalg.norm(draws, axis=1), 3) == pytest.approx(1.0, abs=0.03)


def test_good_sets_rarely_lose_a_block():
    rng = np.random.default_rng(2)
    limit = largest_believable(120, 3)
    worst = np.linalg.norm(rng.normal(size=(2000, 120, 3)), axis=2).max(axis=1)
    assert 0.003 < np.mean(worst > limit) < 0.02
