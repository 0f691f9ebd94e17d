"""Error columns: how points move by what a model may lack, for tests of it and for models of it.

A term f(q) of a joint's transmission moves the point by J f(q), J = ∂point/∂joint: the mechanism's
own derivatives carry every such error, in the axes in which they are given.
"""

from itertools import combinations_with_replacement

import numpy as np

from campaigns.arrays import Array
from campaigns.mechanisms.transmission import LEFT_BEHIND

DEGREE = 2
TINY = 1e-9
"""Instead of lengths of 0, by which nothing can be divided."""
LEVEL_MM = 1.0
"""Of a point nearer to the standing axis it is not known which way is sideways."""


def of_joints(by_joints: Array, *terms: Array) -> Array:
    """Columns (N, 3, n · k) of k functions of joints, (N, n) each, a joint's together."""
    columns = by_joints[..., None] * np.stack(terms, axis=-1)[:, None]
    return np.asarray(columns.reshape(*by_joints.shape[:2], -1))


def harmonic(by_joints: Array, angle_rad: Array) -> Array:
    """Sine and cosine of angles (N, n): eccentric encoders; a gear's or a screw's period."""
    return of_joints(by_joints, np.sin(angle_rad), np.cos(angle_rad))


def backlash(by_joints: Array, approach: Array) -> Array:
    """Backlash of each joint that came by `approach` (N, n), (N, 3, n)."""
    return of_joints(by_joints, LEFT_BEHIND * approach)


def sag_by_reach(up: Array, positions_mm: Array, reach_mm: float) -> Array:
    """Heights along `up` (N, 3) that follow the place in the base frame, (N, 3, 4).

    By x, y, x² + y² and z in parts of the reach: the third is what the plate sags by at its end.
    """
    x, y, z = positions_mm.T / max(reach_mm, TINY)
    return np.asarray(up[:, :, None] * np.stack([x, y, -(x**2) - y**2, z], axis=1)[:, None])


def yielding(by_joints: Array, up: Array) -> Array:
    """Gears that yield under the plate's weight, (N, 3, n), by how much each lowers it at most.

    Their torques are as the heights ∂z/∂q along `up` (N, 3): virtual work.
    """
    rise = np.einsum("nkj,nk->nj", by_joints, up)
    return of_joints(by_joints, -rise / np.maximum(np.square(rise).max(axis=0), TINY))


def reflector_constant(points_in_tracker_mm: Array) -> Array:
    """Ranges that are longer by 1 mm, (N, 3, 1)."""
    ranges_mm = np.linalg.norm(points_in_tracker_mm, axis=1, keepdims=True)
    return np.asarray((points_in_tracker_mm / np.maximum(ranges_mm, TINY))[:, :, None])


def transit_axis(points_in_tracker_mm: Array) -> Array:
    """Azimuths of a tracker whose axes are 1 rad out of square, (N, 3, 1): by the tangent of ε."""
    z = points_in_tracker_mm[:, 2]
    return np.asarray(z[:, None, None] * _sideways(points_in_tracker_mm))


def collimation(points_in_tracker_mm: Array) -> Array:
    """Beams that are 1 rad off the normal of the transit axis, (N, 3, 1)."""
    ranges_mm = np.linalg.norm(points_in_tracker_mm, axis=1)
    return np.asarray(ranges_mm[:, None, None] * _sideways(points_in_tracker_mm))


def vertical_index(points_in_tracker_mm: Array) -> Array:
    """Elevations that are larger by 1 rad, (N, 3, 1)."""
    sideways = _sideways(points_in_tracker_mm)[:, :, 0]
    return np.asarray(np.cross(points_in_tracker_mm, sideways)[:, :, None])


def _sideways(points_in_tracker_mm: Array) -> Array:
    """Unit vectors across the beam, level, (N, 3, 1); arbitrarily small on the standing axis."""
    x, y, z = points_in_tracker_mm.T
    level_mm = np.maximum(np.hypot(x, y), LEVEL_MM)
    return np.asarray((np.stack([-y, x, np.zeros_like(z)], axis=1) / level_mm[:, None])[:, :, None])


def smooth(joints: Array) -> Array:
    """Displacements of points (N, 3, m) that are polynomials of the joints (N, n)."""
    spread = joints.std(axis=0)
    scaled = (joints - joints.mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)
    places = range(joints.shape[1])
    terms = [
        np.prod(scaled[:, list(chosen)], axis=1)
        for degree in range(1, DEGREE + 1)
        for chosen in combinations_with_replacement(places, degree)
    ]
    columns = np.zeros((len(joints), 3, len(terms), 3))
    for axis in range(3):
        columns[:, axis, :, axis] = np.stack(terms, axis=1)
    return np.asarray(columns.reshape(len(joints), 3, -1))
