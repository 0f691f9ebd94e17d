"""Rigid transforms: fitted, inverted, and as the paper's angles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from campaigns.fit.rigid_transforms import (
    Transform,
    fit_transform,
    from_paper_angles,
    paper_angles_rad,
    rotation_vector_rad,
)
from campaigns.kinematics.rotations import matrices_of

ANGLE = st.floats(-np.pi, np.pi)
PLACE_MM = st.floats(-5000.0, 5000.0)
SEED = st.integers(0, 2**32 - 1)


def about(axis, angle):
    turn, (first, second) = np.eye(3), np.arange(axis + 1, axis + 3) % 3
    turn[first, first] = turn[second, second] = np.cos(angle)
    turn[second, first], turn[first, second] = np.sin(angle), -np.sin(angle)
    return turn


def cloud(seed, count=20):
    return np.random.default_rng(seed).uniform(-500.0, 500.0, (count, 3))


@given(st.tuples(ANGLE, ANGLE, ANGLE), st.tuples(PLACE_MM, PLACE_MM, PLACE_MM), SEED)
def test_a_fitted_transform_is_the_one_that_moved_the_points(angles, place_mm, seed):
    moved = from_paper_angles(np.array(angles), np.array(place_mm))
    points = cloud(seed)
    fitted = fit_transform(points, moved.apply(points))
    assert np.abs(fitted.rotation - moved.rotation).max() < 1e-12
    assert np.abs(fitted.translation_mm - moved.translation_mm).max() < 1e-9
    assert np.abs(fitted.inverted().apply(moved.apply(points)) - points).max() < 1e-9


def test_three_points_in_a_plane_or_mirrored_are_met_by_a_rotation_and_two_fix_none():
    moved = Transform(about(2, 0.3), np.array([1.0, 2.0, 3.0]))
    points = np.array([[0.0, 0, 0], [100, 0, 0], [0, 100, 0]])
    fitted = fit_transform(points, moved.apply(points))
    assert np.abs(fitted.rotation - moved.rotation).max() < 1e-14
    points = cloud(3)
    fitted = fit_transform(points, points * [1.0, 1.0, -1.0])
    assert np.linalg.det(fitted.rotation) == pytest.approx(1.0, abs=1e-12)
    points = cloud(4) * [1.0, 1.0, 0.0]
    moved = Transform(about(0, 2.5) @ about(2, 1.0), np.zeros(3))
    fitted = fit_transform(points, moved.apply(points))
    assert np.abs(fitted.rotation - moved.rotation).max() < 1e-12
    with pytest.raises(ValueError, match="2 points"):
        fit_transform(np.eye(3)[:2], np.eye(3)[:2])


def test_noise_is_shared_out_by_least_squares():
    points = cloud(1, 40)
    noisy = points + np.random.default_rng(2).normal(0.0, 0.1, points.shape)
    fitted = fit_transform(points, noisy)
    best, _ = Rotation.align_vectors(noisy - noisy.mean(axis=0), points - points.mean(axis=0))
    assert np.abs(fitted.rotation - best.as_matrix()).max() < 1e-12
    assert np.abs((fitted.apply(points) - noisy).mean(axis=0)).max() < 1e-9


@pytest.mark.parametrize("points", [np.outer(np.arange(5.0), [1.0, 2.0, 3.0]), np.ones((5, 3))])
def test_points_on_a_line_fix_no_frame(points):
    with pytest.raises(ValueError, match="one line"):
        fit_transform(points, points)


@given(st.floats(0.0, np.pi) | st.floats(3.14159, np.pi) | st.floats(0.0, 1e-9), SEED)
def test_turns_up_to_half_a_turn_are_those_of_scipy(angle, seed):
    axis = np.random.default_rng(seed).normal(size=3)
    rotation = Rotation.from_rotvec(vector := angle * axis / np.linalg.norm(axis))
    assert np.abs(matrices_of(vector) - rotation.as_matrix()).max() < 4e-15
    again = rotation_vector_rad(rotation.as_matrix())
    assert (Rotation.from_rotvec(again) * rotation.inv()).magnitude() < 4e-15
    assert np.linalg.norm(again) <= np.pi


@given(ANGLE, st.floats(-1.57, 1.57), ANGLE)
def test_the_paper_s_angles_come_back(phi, gamma, psi):
    """Eq. 23: R(z, φ) R(y, γ) R(x, ψ)."""
    rotation = about(2, phi) @ about(1, gamma) @ about(0, psi)
    made = from_paper_angles(np.array([phi, gamma, psi]), np.zeros(3)).rotation
    assert np.abs(made - rotation).max() < 1e-15
    angles = paper_angles_rad(Transform(rotation, np.zeros(3)))
    again = about(2, angles[0]) @ about(1, angles[1]) @ about(0, angles[2])
    assert np.abs(again - rotation).max() < 1e-12
    assert abs(angles[1] - gamma) < 1e-9
