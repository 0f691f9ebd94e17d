"""Rigid transforms: `b_from_a` turns coordinates in frame a into those in frame b."""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from campaigns.arrays import Array

Number = TypeVar("Number", float, Array)
LINE_TOLERANCE = 1e-9
"""Points whose second spread is below this part of the first lie on a line."""


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """A rotation matrix (3, 3) and a translation in mm (3,)."""

    rotation: Array
    translation_mm: Array

    def apply(self, points_mm: Array) -> Array:
        """Points (N, 3) in the other frame."""
        return np.asarray(points_mm @ self.rotation.T + self.translation_mm)

    def after(self, first: "Transform") -> "Transform":
        """This transform behind another one."""
        return Transform(
            self.rotation @ first.rotation,
            self.rotation @ first.translation_mm + self.translation_mm,
        )

    def inverted(self) -> "Transform":
        """The way back."""
        return Transform(self.rotation.T, -self.rotation.T @ self.translation_mm)


def best_rotation(centred_a: Array, centred_b: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) that brings centred points a (N, 3) best to b, and their common spreads (3,).

    Closed form by SVD (Kabsch 1976). The last spread is negative where a reflection would fit
    better. Of stacks of points b (…, N, 3), (…, 3, 3) and (…, 3).
    """
    u, spread, vt = np.linalg.svd(centred_b.swapaxes(-1, -2) @ centred_a)
    proper = np.ones(spread.shape)
    proper[..., 2] = np.sign(np.linalg.det(u @ vt))
    return (u * proper[..., None, :]) @ vt, spread * proper


def fit_transform(points_in_a_mm: Array, points_in_b_mm: Array) -> Transform:
    """`b_from_a` with the least sum of squared distances, from (N, 3) points each (paper eq. 25).

    Raises `ValueError` for fewer than three points and for points on a line.
    """
    rotations, translations_mm = fit_frames(points_in_a_mm, points_in_b_mm[None])
    return Transform(rotations[0], translations_mm[0])


def fit_frames(points_in_a_mm: Array, points_mm: Array) -> tuple[Array, Array]:
    """Rotations (C, 3, 3) and translations (C, 3) of points (N, 3) to each of (C, N, 3), likewise.

    Raises `ValueError` where one cannot be told.
    """
    if len(points_in_a_mm) < 3:
        raise ValueError(f"{len(points_in_a_mm)} points fix no frame: three are needed")
    centre, centres = points_in_a_mm.mean(axis=0), points_mm.mean(axis=1)
    rotations, spread = best_rotation(points_in_a_mm - centre, points_mm - centres[:, None])
    if (spread[:, 1] <= LINE_TOLERANCE * spread[:, 0]).any():
        raise ValueError("points on one line fix no frame")
    return rotations, centres - rotations @ centre


def frame_jacobian(points_mm: Array) -> Array:
    """∂point by a small turn and a shift of its frame, (N, 3, 6), of points (N, 3)."""
    columns = np.zeros((len(points_mm), 3, 6))
    x, y, z = points_mm.T
    columns[:, 0, 1], columns[:, 0, 2] = z, -y
    columns[:, 1, 0], columns[:, 1, 2] = -z, x
    columns[:, 2, 0], columns[:, 2, 1] = y, -x
    columns[:, :, 3:] = np.eye(3)
    return columns


def paper_angles_rad(transform: Transform) -> Array:
    """φ, γ, ψ of R(z, φ) R(y, γ) R(x, ψ) (paper eq. 23), (3,).

    Where γ is ± 90°, φ is 0 or whatever rounding makes of it, and ψ is the rest.
    """
    x, y, z = transform.rotation
    phi = np.arctan2(y[0], x[0])
    sine, cosine = np.sin(phi), np.cos(phi)
    unturned_x, unturned_y = cosine * x + sine * y, cosine * y - sine * x
    gamma = np.arctan2(-z[0], unturned_x[0])
    return np.array([phi, gamma, np.arctan2(-unturned_y[2], unturned_y[1])])


def from_paper_angles(angles_rad: Array, translation_mm: Array) -> Transform:
    """R(z, φ) R(y, γ) R(x, ψ) and a translation (paper eqs. 22 and 23), from (3,) each."""
    turn, _ = small_rotation(angles_rad)
    return Transform(turn, translation_mm)


def small_rotation(angles_rad: Array) -> tuple[Array, Array]:
    """R(z, a0) R(y, a1) R(x, a2), (…, 3, 3), and its derivatives by the three angles.

    Angles are (…, 3), derivatives (…, 3, 3, 3).
    """
    is_one = angles_rad.ndim == 1  # whose plain numbers take a third of the time
    cos, sin = (
        of(angles_rad).tolist() if is_one else np.moveaxis(of(angles_rad), -1, 0)
        for of in (np.cos, np.sin)
    )
    every = np.array(rotation_entries(*cos, *sin))
    turns = every if is_one else np.moveaxis(every, (0, 1, 2), (-3, -2, -1))
    return turns[..., 0, :, :], turns[..., 1:, :, :]


def rotation_entries(
    cz: Number, cy: Number, cx: Number, sz: Number, sy: Number, sx: Number
) -> tuple[tuple[tuple[Number, ...], ...], ...]:
    """Rows of `small_rotation` and of its three derivatives, of the angles' cosines and sines.

    Compiled loops are made of the same lines.
    """
    none = cz - cz
    first = (cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx)
    second = (sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx)
    third = (-sy, cy * sx, cy * cx)
    by_z = ((-second[0], -second[1], -second[2]), first, (none, none, none))
    by_y = (
        (-sy * cz, cy * sx * cz, cy * cx * cz),
        (-sy * sz, cy * sx * sz, cy * cx * sz),
        (-cy, -sy * sx, -sy * cx),
    )
    by_x = ((none, first[2], -first[1]), (none, second[2], -second[1]), (none, third[2], -third[1]))
    return (first, second, third), by_z, by_y, by_x
