"""Rotations of platforms by rotation vectors: an axis times its angle, rad, in the base frame.

Vectors of all arms are sequences of x, y, z, each (…, N, n). Functions that closures call keep
complex numbers, so that derivatives can be taken by steps into the imaginary direction.
"""

from collections.abc import Sequence

import numpy as np

from campaigns.arrays import Array

SMALL_SQUARE = 1e-8
"""Square of an angle below which the series of its sine is exact to rounding."""


# Rodrigues' formula: R v = v + s ω×v + c ω×(ω×v), with s = sin φ / φ, c = (1 - cos φ) / φ² and
# φ = |ω|. φ itself is no derivative of ω at 0, but s and c are series of φ².
def turned_by(turns: Array, vectors: Sequence[Array]) -> list[Array]:
    """Return vectors turned by rotation vectors.

    Args:
        turns: Rotation vectors (…, N, 3), rad, one for each pose.
        vectors: x, y and z of vectors, (…, 1, n) each, one for each arm.

    Returns:
        x, y and z of the turned vectors, (…, N, n) each.
    """
    axis = [turns[..., place, None] for place in range(3)]
    square = axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2
    sine, versine = _factors(square)
    first = _cross(axis, vectors)
    second = _cross(axis, first)
    return [v + sine * f + versine * s for v, f, s in zip(vectors, first, second, strict=True)]


def matrices_of(turns: Array) -> Array:
    """Return the matrices of rotation vectors.

    Args:
        turns: Rotation vectors (…, 3), rad.

    Returns:
        Rotation matrices (…, 3, 3); their columns are the turned axes.
    """
    columns = turned_by(turns, list(np.eye(3)))
    return np.stack(columns, axis=-2)


# Of frames that differ by the angle φ about the unit vector n, the sum of the axes' vector products
# is 2 sin φ n, and that of their scalar products 1 + 2 cos φ. 2 tan(φ/2) n follows without a root,
# smooth where the frames agree. sin φ alone would vanish half a turn away too, where Newton's
# method would take it for an assembly; the tangent grows beyond bounds there.
def turn_between(first: Array, second: Array) -> Array:
    """Return the turns from rotation matrices to others, as closures compare orientations.

    Args:
        first: Rotation matrices (…, 3, 3).
        second: Rotation matrices (…, 3, 3).

    Returns:
        Rotation vectors (…, 3) of the length 2 tan(φ/2), rad: the angle φ to within φ³ / 12.
        Infinite or NaN at exactly half a turn, whose axis has no sign.
    """
    sine = np.asarray(np.cross(first, second, axis=-2).sum(axis=-1))
    trace = (first * second).sum(axis=(-2, -1))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(2.0 * sine / (1.0 + trace)[..., None])


# A rotation vector's change dω is no turn: the body turns by J dω, with
# J = 1 + c [ω]× + d [ω]×², c = (1 - cos φ) / φ² and d = (φ - sin φ) / φ³ (Chirikjian 2011, ch. 10).
def turns_of_changes(turns: Array) -> Array:
    """Return the matrices J (N, 3, 3) from changes of rotation vectors (N, 3) to turns, rad.

    The turns are about the base's axes.
    """
    skew = np.stack([_cross(list(turns.T), list(row)) for row in np.eye(3)], axis=-1)  # (3, N, 3)
    skew = np.moveaxis(skew, 0, 1)
    square = (turns**2).sum(axis=1)
    sine, versine = _factors(square)
    is_small = square < SMALL_SQUARE
    cubic = np.where(is_small, 1.0 / 6.0, (1.0 - sine) / np.where(is_small, 1.0, square))
    return np.asarray(
        np.eye(3) + versine[:, None, None] * skew + cubic[:, None, None] * (skew @ skew)
    )


def _factors(square: Array) -> tuple[Array, Array]:
    """Return sin φ / φ and (1 - cos φ) / φ² of squared angles φ²."""
    is_small = np.abs(square) < SMALL_SQUARE
    angle = np.sqrt(np.where(is_small, 1.0, square))
    sine = np.where(is_small, 1.0 - square / 6.0, np.sin(angle) / angle)
    # 1 - cos φ = 2 sin²(φ/2), without a difference to cancel
    versine = np.where(is_small, 0.5 - square / 24.0, 2.0 * (np.sin(0.5 * angle) / angle) ** 2)
    return sine, versine


def _cross(a: Sequence[Array], b: Sequence[Array]) -> list[Array]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
