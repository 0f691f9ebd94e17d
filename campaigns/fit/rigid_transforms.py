"""Distances and rigid transforms of points: `b_from_a` turns coordinates in a into those in b.

Pairs of points are two arrays of rows, (M,) each. Rotations are written out here: importing those
of SciPy would take a third of the time in which commands start.
"""

from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.kinematics.rotations import matrices_of

MRAD = 1e-3
LINE_TOLERANCE = 1e-9
"""Points whose second spread is below this part of the first lie on a line."""
SHOTS_FOR_A_FRAME = 4
"""Least number of points whose best frame is relied on; three fix a frame exactly."""


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """Rotation matrix (3, 3) and translation in mm (3,): p → R p + t."""

    rotation: Array
    translation_mm: Array

    def apply(self, points_mm: Array) -> Array:
        """Return points (N, 3) in the other frame."""
        return np.asarray(points_mm @ self.rotation.T + self.translation_mm)

    def after(self, first: "Transform") -> "Transform":
        """Return the transform that applies `first`, then this one."""
        return Transform(
            self.rotation @ first.rotation,
            self.rotation @ first.translation_mm + self.translation_mm,
        )

    def inverted(self) -> "Transform":
        """Return the inverse transform."""
        return Transform(self.rotation.T, -self.rotation.T @ self.translation_mm)


# With the SVD Σ b a' = U S V', tr(R' Σ b a') is largest, and so the squares are least,
# for R = U D V', where D = diag(1, 1, ± 1) makes det R = 1 (Umeyama 1991): a reflection would
# otherwise come out where points are mirrored, or lie in a plane.
def best_rotation(centred_a: Array, centred_b: Array) -> tuple[Array, Array]:
    """Return the rotations (…, 3, 3) that bring centred points a (…, N, 3) best to b, and spreads.

    Spreads (…, 3) are the singular values of both together. The last is negative where a reflection
    would fit better.
    """
    u, spread, vt = np.linalg.svd(centred_b.swapaxes(-1, -2) @ centred_a)
    proper = np.ones_like(spread)
    proper[..., 2] = np.sign(np.linalg.det(u @ vt))
    return (u * proper[..., None, :]) @ vt, spread * proper


def fit_transform(points_in_a_mm: Array, points_in_b_mm: Array) -> Transform:
    """Return `b_from_a` with the least sum of squared distances of points (N, 3) (paper eq. 25).

    Raise `ValueError` for fewer than three points and for points on a line.
    """
    if len(points_in_a_mm) < 3:
        raise ValueError(f"{len(points_in_a_mm)} points fix no frame: three are needed")
    centre, other = points_in_a_mm.mean(axis=0), points_in_b_mm.mean(axis=0)
    rotation, spread = best_rotation(points_in_a_mm - centre, points_in_b_mm - other)
    if spread[1] <= LINE_TOLERANCE * spread[0]:
        raise ValueError("points on one line fix no frame")
    return Transform(rotation, other - rotation @ centre)


# exp(ψ×) p + t changes by ψ × p + t to first order: the columns are -p× and the identity.
def frame_jacobian(points_mm: Array) -> Array:
    """Return ∂point by a small turn (rad) and a shift (mm) of its frame, (N, 3, 6)."""
    columns = np.zeros((len(points_mm), 3, 6))
    x, y, z = points_mm.T
    columns[:, 0, 1], columns[:, 0, 2] = z, -y
    columns[:, 1, 0], columns[:, 1, 2] = -z, x
    columns[:, 2, 0], columns[:, 2, 1] = y, -x
    columns[:, :, 3:] = np.eye(3)
    return columns


# With the axis n and the angle φ, the elements across the diagonal differ by 2 sin φ n, and R + R'
# is 2 cos φ + 2 (1 - cos φ) n n'. The first gives the vector of up to a quarter of a turn; half a
# turn has no sine, but there the longest column of n n' has the axis, whose sign the sine decides.
def rotation_vector_rad(rotation: Array) -> Array:
    """Return the rotation vector (3,) of a rotation matrix (3, 3)."""
    across = rotation.T - rotation
    twice_sine = np.array([across[1, 2], across[2, 0], across[0, 1]])
    twice_cosine = float(np.trace(rotation)) - 1.0
    angle = np.arctan2(np.linalg.norm(twice_sine), twice_cosine)
    if twice_cosine > 0.0:
        return np.asarray(0.5 * twice_sine / np.sinc(angle / np.pi))
    columns = rotation + rotation.T - twice_cosine * np.eye(3)
    axis = columns[:, np.argmax(np.diag(columns))]
    axis = axis * (-1.0 if axis @ twice_sine < 0.0 else 1.0)
    return np.asarray(angle * axis / np.linalg.norm(axis))


def paper_angles_rad(transform: Transform) -> Array:
    """Return φ, γ, ψ of R(z, φ) R(y, γ) R(x, ψ) (paper eq. 23), (3,).

    Where γ is ± 90°, φ and ψ turn about one axis: φ is 0 or what rounding makes of it, and ψ is the
    whole turn.
    """
    # R(z, φ)⁻¹ R = R(y, γ) R(x, ψ) has the rows (cos γ, …), (0, cos ψ, -sin ψ) and (-sin γ, …): its
    # elements give γ and ψ without a division by cos γ
    x, y, z = transform.rotation
    phi = np.arctan2(y[0], x[0])
    sine, cosine = np.sin(phi), np.cos(phi)
    unturned_x, unturned_y = cosine * x + sine * y, cosine * y - sine * x
    gamma = np.arctan2(-z[0], unturned_x[0])
    return np.array([phi, gamma, np.arctan2(-unturned_y[2], unturned_y[1])])


def from_paper_angles(angles_rad: Array, translation_mm: Array) -> Transform:
    """Return R(z, φ) R(y, γ) R(x, ψ) with a translation (paper eqs. 22 and 23), from (3,) each."""
    z, y, x = matrices_of(np.diag(angles_rad)[:, ::-1])
    return Transform(z @ y @ x, translation_mm)


def distances_mm(points_mm: Array, first: Index, second: Index) -> Array:
    """Return the distances of pairs, (M,) of points (N, 3), (…, M) of stacks (…, N, 3)."""
    between = points_mm[..., second, :] - points_mm[..., first, :]
    return np.asarray(np.linalg.norm(between, axis=-1))


def directions(points_mm: Array, first: Index, second: Index) -> Array:
    """Return unit vectors from the first points to the second, zero where both coincide.

    They are (M, 3) of points (N, 3), and (…, M, 3) of stacks of points (…, N, 3).
    """
    between = points_mm[..., second, :] - points_mm[..., first, :]
    length = np.linalg.norm(between, axis=-1, keepdims=True)
    return np.asarray(between / np.maximum(length, 1e-300))  # 0 / 0 of coincident points is 0


def away_from_mean(points_mm: Array) -> Array:
    """Return the vectors from the mean of the points to each of them, (N, 3)."""
    return np.asarray(points_mm - points_mm.mean(axis=0))


def away_from_best_line(points_mm: Array) -> Array:
    """Return the vectors from the best straight line in space, square to it, to points (N, 3)."""
    centred = away_from_mean(points_mm)
    direction = np.linalg.svd(centred)[2][0]
    return np.asarray(centred - np.outer(centred @ direction, direction))


def fitted_frame(from_mm: Array, to_mm: Array) -> Transform | None:
    """Return the rigid transform that brings points best to others (eqs. 22-25).

    Return None for points that do not fix one well: fewer than four, or all on a line.
    """
    if len(from_mm) < SHOTS_FOR_A_FRAME:
        return None
    try:
        return fit_transform(from_mm, to_mm)
    except ValueError:
        return None


def length_with_std(vector_mm: Array, covariance_mm2: Array) -> tuple[float, float]:
    """Return the length of a vector (3,) and its 1 σ, by its covariance (3, 3).

    A length of 0 has the σ of its worst direction.
    """
    # first-order propagation (GUM 5.2.2): the gradient of |v| is v / |v|, which 0 does not have
    length = float(np.linalg.norm(vector_mm))
    if length == 0.0:
        return 0.0, float(np.sqrt(np.linalg.eigvalsh(covariance_mm2)[-1]))
    along = vector_mm / length
    return length, float(np.sqrt(along @ covariance_mm2 @ along))
