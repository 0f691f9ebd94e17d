"""Directions that nothing determines, σ of positions without the frame's motion, and its budget."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns.fit.posterior import Posterior, fit
from fake_cell import CENTRE, NOMINAL
from small_plans import LIMITS

from campaigns.design.pose_sampling import workspace_poses
from campaigns.fit import uncertainty
from campaigns.fit.error_model import ErrorModel, Observations

NAMES = ("upper_arm1_mm", "forearm1_mm", "scale", "motor1_deg", "motor2_deg")
SHOTS, STD_MM = 40, 0.01


def rows_without(direction: np.ndarray, count: int = 50) -> np.ndarray:
    """Draw derivatives (count, 3, P) of points that do not move along a direction."""
    rows = np.random.default_rng(1).normal(size=(count, 3, len(direction)))
    return rows - (rows @ direction)[..., None] * direction / (direction @ direction)


@pytest.fixture(scope="module")
def posterior() -> Posterior:
    random = np.random.default_rng(2)
    poses = workspace_poses(NOMINAL, LIMITS, CENTRE, SHOTS, random)
    joints = NOMINAL.inverse(poses).values
    points = poses[:, :3] + STD_MM * random.normal(size=(SHOTS, 3)) - CENTRE[:3]
    noise = np.broadcast_to(STD_MM**2 * np.eye(3), (SHOTS, 3, 3))
    observations = replace(
        Observations.unmeasured(joints, poses), points=points, noise={"stated": noise}
    )
    return fit(ErrorModel(NOMINAL), observations)


def test_a_combination_that_moves_no_point_is_named_and_holds_nothing_of_the_covariance():
    hidden = np.array([1.0, 1.0, 0.0, 0.0, 0.0])
    rows = rows_without(hidden)
    information = uncertainty.shot_information(rows, np.broadcast_to(np.eye(3), (50, 3, 3)))
    assert information == pytest.approx(np.einsum("nip,niq->pq", rows, rows))
    null = uncertainty.null_directions_of(information, NAMES)
    assert null.names == (("forearm1_mm", "upper_arm1_mm"),)
    covariance = null.transform_covariance(np.diag([4.0, 1.0, 1.0, 2.0, 3.0]))
    assert hidden @ covariance @ hidden == pytest.approx(0.0, abs=1e-12)
    assert covariance[3, 3] == pytest.approx(2.0)
    assert null.transform(np.array([3.0, 1.0, 5.0, 6.0, 7.0])) == pytest.approx([1, -1, 5, 6, 7])


def test_two_combinations_are_named_by_the_fewest_parameters_and_the_trackers_are_left_out():
    vectors = np.linalg.qr(np.array([[1.0, 1, 0, 0, 0], [0, 0, 0, 1, -1], [0, 0, 1, 0, 0]]).T)[0]
    turned = vectors @ np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    null = uncertainty.NullDirections.spanned_by(turned, NAMES)
    assert null.names == (("forearm1_mm", "upper_arm1_mm"), ("motor1_deg", "motor2_deg"))
    assert uncertainty.NullDirections.spanned_by(np.zeros((5, 0)), NAMES).names == ()


def test_what_is_left_without_the_frames_is_the_inverse_of_the_whole_inverse_block():
    rows = np.random.default_rng(4).normal(size=(30, 9))
    information = rows.T @ rows
    marginal = uncertainty.marginal_information(information, 4)
    assert np.linalg.inv(marginal) == pytest.approx(np.linalg.inv(information)[:4, :4])


def test_a_motion_of_the_frame_is_no_error_of_positions_and_a_change_of_size_is():
    positions = np.random.default_rng(5).uniform(-300.0, 300.0, (20, 3))
    turned = np.array([1.0, 2.0, 3.0]) + np.cross([0.3, -0.2, 0.5], positions)
    grown = positions - positions.mean(axis=0)
    rest = uncertainty.without_frame(np.stack([turned, grown + turned], axis=2), positions)
    assert np.abs(rest[..., 0]).max() < 1e-10
    assert rest[..., 1] == pytest.approx(grown)


def test_sigma_of_positions_is_the_trace_of_their_covariance():
    by = np.random.default_rng(6).normal(size=(7, 3, 2))
    covariance = np.array([[2.0, 0.5], [0.5, 1.0]])
    expected = [np.trace(rows @ covariance @ rows.T) ** 0.5 for rows in by]
    assert uncertainty.position_std_mm(by, covariance) == pytest.approx(expected)


def test_shares_of_the_budget_add_up_and_each_is_what_its_source_gives(posterior):
    size = len(posterior.model.names)
    by = np.random.default_rng(7).normal(size=(9, 3, size))
    shares = uncertainty.budget(posterior, by)
    std = uncertainty.position_std_mm(by, posterior.model_covariance)
    assert sum(shares.values()) == pytest.approx((std**2).mean(), rel=1e-6)
    part = posterior.components.factors["stated"] * posterior.noise["stated"]
    weighted = posterior.weights @ posterior.at.jacobian
    propagated = posterior.covariance @ np.einsum("nip,nij,njq->pq", weighted, part, weighted)
    covariance = (propagated @ posterior.covariance)[:size, :size]
    expected = (uncertainty.position_std_mm(by, covariance) ** 2).mean()
    assert shares["stated"] == pytest.approx(expected, rel=1e-6)
    assert all(share >= 0.0 for share in shares.values())


def test_only_the_robots_place_in_its_base_is_undetermined_by_good_shots(posterior):
    null = uncertainty.null_directions(posterior)
    moved = posterior.at.jacobian[..., : len(posterior.model.names)] @ null.vectors
    frame = posterior.at.jacobian[..., -6:].reshape(-1, 6)
    rest = moved.reshape(len(frame), -1)
    rest = rest - frame @ np.linalg.lstsq(frame, rest, rcond=None)[0]
    assert null.vectors.shape[1] > 0
    assert np.abs(rest).max() < STD_MM / 10.0
