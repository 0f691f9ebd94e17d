"""Two-face error of a tracker's angles, by points measured in both faces, and points without it.

In the other face collimation error and vertical index error have the other sign: half the
difference of both is the error. They are constant enough over a series to be taken out of points
that were measured in one face.
"""

import numpy as np

from campaigns.arrays import Array


def two_face_error_rad(first_mm: Array, second_mm: Array) -> tuple[float, float]:
    """Collimation and vertical index error of the first face, by points (N, 3) in both."""
    (azimuth, zenith, _), (other_azimuth, other_zenith, _) = map(_angles, (first_mm, second_mm))
    across = np.remainder(azimuth - other_azimuth + np.pi, 2.0 * np.pi) - np.pi
    collimation = 0.5 * across * np.sin(0.5 * (zenith + other_zenith))
    return float(collimation.mean()), 0.5 * float((zenith - other_zenith).mean())


def without_two_face_error(points_mm: Array, collimation_rad: float, index_rad: float) -> Array:
    """Points (N, 3) of the first face as they are without these errors."""
    azimuth, zenith, range_mm = _angles(points_mm)
    zenith = zenith - index_rad
    azimuth = azimuth - collimation_rad / np.sin(zenith)
    across = range_mm * np.sin(zenith)
    return np.stack(
        [across * np.cos(azimuth), across * np.sin(azimuth), range_mm * np.cos(zenith)], axis=1
    )


def _angles(points_mm: Array) -> tuple[Array, Array, Array]:
    """Azimuth and zenith angle, rad, and range, mm, of points (N, 3), (N,) each."""
    x, y, z = points_mm.T
    return np.arctan2(y, x), np.arctan2(np.hypot(x, y), z), np.linalg.norm(points_mm, axis=1)
