"""Par4's forward model (paper eq. 18): a guarded Newton iteration that knows when there is no assembly.

For given joints two real assemblies lie in the working region. The wanted one has |θ| < 90° and is the
lower; at the other the determinant of the closures' Jacobian has the opposite sign. Newton alone ends
on the wrong one, or far away, for about one pose in a hundred, so every answer is checked for residual,
angle and branch, and what fails is started again from elsewhere.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from campaigns.numerics.geometry import Array, Geometry
from campaigns.numerics.par4 import Assembly, Solution, elbows_mm

CHUNK = 4096
"""Rows worked on at a time, so that they stay in the processor's cache."""
ITERATIONS = 40
STEP_MM = 120.0
STEP_RAD = 0.35
CONVERGED_MM = 1e-7
"""A Newton step shorter than this leaves an error of the order of its square."""
RESIDUAL_MM = 1e-6

Triple = tuple[Array, Array, Array]
STARTS = (
    (0.0, 0.0),
    (0.6, -40.0),
    (-0.6, -40.0),
    (0.0, -150.0),
    (0.9, 60.0),
    (-0.9, 60.0),
    (0.0, 150.0),
)
"""θ in rad and height above the guessed one in mm, tried in turn."""


@dataclass(frozen=True, slots=True, eq=False)
class _Legs:
    """Elbows by component, each (4, N), and the constants that go with them."""

    x: Array
    y: Array
    z: Array
    forearm_mm: Array
    plate_mm: float

    def rows(self, chosen: NDArray[np.bool_]) -> "_Legs":
        return _Legs(
            self.x[:, chosen], self.y[:, chosen], self.z[:, chosen], self.forearm_mm, self.plate_mm
        )


def forward(geometry: Geometry, joints_rad: Array, start: Array | None = None) -> Solution:
    """Poses of joints, both (N, 4). `start` (N, 4) is a pose near each answer, such as the commanded one."""
    joints = np.atleast_2d(np.asarray(joints_rad, dtype=np.float64))
    poses = np.empty_like(joints)
    outcome = np.empty(len(joints), dtype=np.uint8)
    for first in range(0, len(joints), CHUNK):
        rows = slice(first, first + CHUNK)
        poses[rows], outcome[rows] = _solve(
            geometry, joints[rows], None if start is None else np.atleast_2d(start)[rows]
        )
    return Solution(poses, outcome)


def _solve(
    geometry: Geometry, joints: Array, start: Array | None
) -> tuple[Array, NDArray[np.uint8]]:
    elbows = elbows_mm(geometry, joints)
    legs = _Legs(
        *(np.ascontiguousarray(elbows[:, :, axis].T) for axis in range(3)),
        geometry.forearm_mm[:, None],
        geometry.plate_mm,
    )
    poses = np.full((4, len(joints)), np.nan)
    pending = np.ones(len(joints), dtype=bool)
    if start is not None:
        poses, good = _newton(legs, np.ascontiguousarray(start.T))
        pending = ~good
    for theta_rad, lift_mm in STARTS:
        if not pending.any():
            break
        some = legs.rows(pending)
        found, good = _newton(some, _guess(some, theta_rad, lift_mm))
        places = np.flatnonzero(pending)[good]
        poses[:, places] = found[:, good]
        pending[places] = False
    poses[:, pending] = np.nan
    return poses.T, np.where(pending, Assembly.NONE, Assembly.FOUND).astype(np.uint8)


def _guess(legs: _Legs, theta_rad: float, lift_mm: float) -> Array:
    """A plate hanging under the middle of its elbows."""
    x, y = legs.x.mean(axis=0), legs.y.mean(axis=0)
    radius2 = (legs.x - x) ** 2 + (legs.y - y) ** 2
    drop2 = np.maximum(legs.forearm_mm**2 - radius2, 0.0).mean(axis=0)
    z = legs.z.mean(axis=0) - np.sqrt(drop2) + lift_mm
    half = 0.5 * legs.plate_mm
    theta = np.full_like(x, theta_rad)
    return np.stack([x + half * np.sin(theta), y - half * np.cos(theta), z, theta])


def _newton(legs: _Legs, start: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Poses (4, N) and which of them passed the checks."""
    poses = start.copy()
    good = np.zeros(poses.shape[1], dtype=bool)
    active = np.arange(poses.shape[1])
    some, current = legs, poses.copy()
    for _ in range(ITERATIONS):
        step, branch, residual = _newton_step(some, current)
        current += step
        size = np.abs(step[:3]).max(axis=0) + 100.0 * np.abs(step[3])
        done = size < CONVERGED_MM
        if done.any() or not np.isfinite(size).all():
            right = (np.abs(current[3]) < 0.5 * np.pi) & (branch > 0.0) & (residual < RESIDUAL_MM)
            poses[:, active] = current
            good[active] = done & right
            keep = ~done & np.isfinite(size)
            if not keep.any():
                break
            active, current, some = active[keep], current[:, keep], some.rows(keep)
    return poses, good


def _newton_step(legs: _Legs, poses: Array) -> tuple[Array, Array, Array]:
    """Limited step (4, N), the branch's determinant and the residual before the step in mm.

    The first two closures don't know θ: they leave one free direction, their forearms' normal, along
    which the other two are solved. This is the 4 x 4 system by hand, some ten times faster in batch.
    """
    sin, cos = np.sin(poses[3]), np.cos(poses[3])
    h = legs.plate_mm
    wx, wy, wz = poses[0] - legs.x, poses[1] - legs.y, poses[2] - legs.z
    wx[2:] -= h * sin
    wy[2:] += h * cos
    f = 0.5 * (wx * wx + wy * wy + wz * wz - legs.forearm_mm**2)
    nx = wy[0] * wz[1] - wz[0] * wy[1]
    ny = wz[0] * wx[1] - wx[0] * wz[1]
    nz = wx[0] * wy[1] - wy[0] * wx[1]
    # particular solution of the first two rows: (-f0 w1 + f1 w0) x n / |n|^2
    ax, ay, az = (f[1] * w[0] - f[0] * w[1] for w in (wx, wy, wz))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        scale = 1.0 / (nx * nx + ny * ny + nz * nz)
        px = (ay * nz - az * ny) * scale
        py = (az * nx - ax * nz) * scale
        pz = (ax * ny - ay * nx) * scale
        g = -h * (cos * wx[2:] + sin * wy[2:])
        m = nx * wx[2:] + ny * wy[2:] + nz * wz[2:]
        r = -f[2:] - (px * wx[2:] + py * wy[2:] + pz * wz[2:])
        determinant = m[0] * g[1] - m[1] * g[0]
        t = (r[0] * g[1] - r[1] * g[0]) / determinant
        step = np.stack(
            [px + t * nx, py + t * ny, pz + t * nz, (m[0] * r[1] - m[1] * r[0]) / determinant]
        )
        excess = np.maximum(np.abs(step[:3]).max(axis=0) / STEP_MM, np.abs(step[3]) / STEP_RAD)
        step /= np.maximum(excess, 1.0)
    residual = np.abs(f).max(axis=0) / legs.forearm_mm.max()
    return step, determinant, residual
