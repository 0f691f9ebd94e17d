"""Rotation vectors against SciPy's, also of complex numbers and near the ends."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from campaigns.kinematics.rotations import matrices_of, turn_between, turned_by, turns_of_changes

STEP = 1e-6
ANGLES = [0.0, 1e-9, 1e-5, 1.1e-4, 0.3, 2.0, 3.1]
"""On both sides of the angle below which sines are series."""

vectors = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3).map(np.array)


def some_turns(angle):
    axes = np.random.default_rng(1).normal(size=(5, 3))
    return angle * axes / np.linalg.norm(axes, axis=1, keepdims=True)


@pytest.mark.parametrize("angle", ANGLES)
def test_vectors_and_matrices_are_turned_as_scipy_turns_them(angle):
    turns, places = some_turns(angle), np.random.default_rng(2).normal(size=(4, 3))
    found = np.stack(turned_by(turns, list(places.T)), axis=-1)
    matrices = Rotation.from_rotvec(turns).as_matrix()
    assert np.abs(found - np.einsum("nij,mj->nmi", matrices, places)).max() < 1e-14
    assert np.abs(matrices_of(turns) - matrices).max() < 1e-14


@pytest.mark.parametrize("angle", ANGLES)
def test_a_change_of_the_vector_turns_the_body_as_differences_say(angle):
    turns = some_turns(angle)
    at = Rotation.from_rotvec(turns)
    found = turns_of_changes(turns)
    for column, axis in enumerate(np.eye(3)):
        further, back = (Rotation.from_rotvec(turns + s * STEP * axis) for s in (1.0, -1.0))
        by_step = ((further * at.inv()).as_rotvec() - (back * at.inv()).as_rotvec()) / (2.0 * STEP)
        assert np.abs(found[..., column] - by_step).max() < 1e-8


@pytest.mark.parametrize("angle", ANGLES)
def test_steps_into_the_imaginary_direction_are_derivatives(angle):
    """Of R v, which is that of the turn: R v changes by (J dω) × R v."""
    turns, place = some_turns(angle), np.array([0.3, -1.0, 2.0])
    moved = np.stack(turned_by(turns, list(place[:, None])), axis=-1)[:, 0]
    for column, axis in enumerate(np.eye(3)):
        stepped = turned_by(turns + 1e-200j * axis, list(place[:, None]))
        found = np.stack(stepped, axis=-1)[:, 0].imag / 1e-200
        assert np.abs(found - np.cross(turns_of_changes(turns)[..., column], moved)).max() < 1e-13


@given(vectors, vectors)
def test_the_turn_between_frames_is_twice_the_tangent_of_half_the_angle(first, second):
    frames = Rotation.from_rotvec(first), Rotation.from_rotvec(second)
    between = (frames[1] * frames[0].inv()).as_rotvec()
    angle = np.linalg.norm(between)
    found = turn_between(*(frame.as_matrix() for frame in frames))
    if angle < 3.0:
        expected = between * (2.0 * np.tan(angle / 2.0) / angle if angle else 1.0)
        assert np.abs(found - expected).max() < 1e-9 * (1.0 + np.abs(expected).max())


def test_frames_half_a_turn_apart_do_not_seem_to_agree():
    """The sine of the angle between them vanishes."""
    nearly = Rotation.from_rotvec([0.0, 0.0, np.pi - 1e-4]).as_matrix()
    assert np.abs(turn_between(np.eye(3), nearly)).max() > 1e4


def test_frames_exactly_half_a_turn_apart_differ_without_a_warning():
    """A robot whose θ goes from -90° to 90° asks for it, and warnings reach the user's screen."""
    turned = np.diag([-1.0, -1.0, 1.0])
    assert not np.isfinite(turn_between(np.eye(3), turned)).all()
