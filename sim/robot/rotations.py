"""Rotations by three angles about fixed axes, with their derivatives."""

import math

import numpy as np

from sim.geometry import Array


def _about(axis: int, angle_rad: float) -> tuple[Array, Array]:
    """The rotation about one axis and its derivative."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    turn, rate = np.eye(3), np.zeros((3, 3))
    turn[first, first] = turn[second, second] = cosine
    turn[first, second], turn[second, first] = -sine, sine
    rate[first, first] = rate[second, second] = -sine
    rate[first, second], rate[second, first] = -cosine, cosine
    return turn, rate


def rotation(about_x: float, about_y: float, about_z: float) -> Array:
    """(3, 3): turned about x, then y, then z of the fixed frame, rad."""
    return np.asarray(_about(2, about_z)[0] @ _about(1, about_y)[0] @ _about(0, about_x)[0])


def rotation_and_rates(about_x: float, about_y: float, about_z: float) -> tuple[Array, Array]:
    """The same, and its derivatives (3, 3, 3) by the three angles."""
    (x, dx), (y, dy), (z, dz) = _about(0, about_x), _about(1, about_y), _about(2, about_z)
    zy = z @ y
    return zy @ x, np.stack([zy @ dx, z @ dy @ x, dz @ y @ x])
