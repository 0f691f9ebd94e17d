"""Frames of the base that see given directions as they are wanted."""

import numpy as np

from campaigns.arrays import Array

UP = np.array([0.0, 0.0, 1.0])


def upright_seen_from(directions: Array, rises: Array) -> Array:
    """Unit vector (3,) nearest upright along which two unit vectors (2, 3) rise by so much, (2,).

    Of parallel directions, which leave one way to tilt open, the one that tilts least.
    """
    within = np.linalg.lstsq(directions, rises, rcond=None)[0]
    across = np.cross(*directions)
    if not across.any():
        across = UP - directions[0] * (directions[0] @ UP)
    across = across / np.linalg.norm(across)
    found = within + np.sqrt(max(1.0 - float(within @ within), 0.0)) * across
    return np.asarray(found if found[2] > 0.0 else within - (found - within))


def tilting(up: Array) -> Array:
    """Least rotation (3, 3) that takes a unit vector to the vertical."""
    return rotation_to(up, UP)


def rotation_to(one: Array, other: Array) -> Array:
    """Least rotation (3, 3) that takes a unit vector to another, which is not its opposite."""
    x, y, z = np.cross(one, other)
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + skew + skew @ skew / (1.0 + one @ other))


def about_x(angle_rad: float) -> Array:
    """Rotation (3, 3) about x."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])


def about_z(angle_rad: float) -> Array:
    """Rotation (3, 3) about z."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
