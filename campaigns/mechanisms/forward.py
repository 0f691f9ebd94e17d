"""Par4's forward model (paper eq. 18): a guarded Newton that knows when there is no assembly.

For given joints two real assemblies lie in the working region. The wanted one has |θ| < 90° and is
the lower; at the other the determinant of the closures' Jacobian has the opposite sign. Newton
alone ends on the wrong one, or far away, for about one pose in a hundred, so every answer is
checked for residual, angle, branch and for hanging below its elbows, and what fails is started
again from elsewhere.
"""

from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array, Mask
from campaigns.mechanisms.geometry import Geometry
from campaigns.mechanisms.par4 import Arms, KinematicSolution, KinematicStatus

CHUNK = 4096
"""Rows worked on at a time, so that they stay in the processor's cache."""
ITERATIONS = 40
STEP_MM = 120.0
STEP_RAD = 0.35
CONVERGED_MM = 1e-5
"""A Newton step shorter than this leaves an error of its square over the forearm's length."""
MISFIT_OF_STEP = 10.0
"""How much longer than that step a forearm may have been too long before it."""
LEVER_MM = 100.0
"""Compares a step in θ with one in position."""
NEXT, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
"""The component after each of x, y, z, and the one after that."""

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
    """Elbows by component, (3, 4, N), and the constants that go with them."""

    elbows_mm: Array
    forearm_mm: Array
    """(4, 1)"""
    plate_mm: float

    def rows(self, chosen: Mask) -> "_Legs":
        return _Legs(self.elbows_mm[:, :, chosen], self.forearm_mm, self.plate_mm)


def forward(geometry: Geometry, joints_rad: Array, start: Array | None = None) -> KinematicSolution:
    """Poses of joints, both (N, 4).

    `start` (N, 4) is a pose near each answer, such as the commanded one.
    """
    joints = np.atleast_2d(np.asarray(joints_rad, dtype=np.float64))
    near = None if start is None else np.atleast_2d(start)
    poses = np.empty_like(joints)
    outcome = np.empty(len(joints), dtype=np.uint8)
    for first in range(0, len(joints), CHUNK):
        rows = slice(first, first + CHUNK)
        some_near = None if near is None else near[rows]
        solved = forward_at(Arms.at(geometry, joints[rows]), some_near)
        poses[rows], outcome[rows] = solved.values, solved.outcome
    return KinematicSolution(poses, outcome)


def forward_at(
    arms: Arms, start: Array | None = None, converged_mm: float = CONVERGED_MM
) -> KinematicSolution:
    """`forward` for arms that are at their joints already; a step below `converged_mm` is the last.

    That leaves an error of about its square over the forearm's length.
    """
    legs = _Legs(arms.elbows_mm, arms.geometry.forearm_mm[:, None], arms.geometry.plate_mm)
    if start is None:
        poses, good = _newton(legs, _guess(legs, *STARTS[0]), converged_mm)
    else:
        poses, good = _newton(legs, np.ascontiguousarray(start.T), converged_mm)
    pending = ~good
    for theta_rad, lift_mm in STARTS if start is not None else STARTS[1:]:
        if not pending.any():
            break
        some = legs.rows(pending)
        found, good = _newton(some, _guess(some, theta_rad, lift_mm), converged_mm)
        places = np.flatnonzero(pending)[good]
        poses[:, places] = found[:, good]
        pending[places] = False
    poses[:, pending] = np.nan
    outcome = np.where(pending, KinematicStatus.NONE, KinematicStatus.FOUND)
    return KinematicSolution(poses.T, outcome.astype(np.uint8))


def _guess(legs: _Legs, theta_rad: float, lift_mm: float) -> Array:
    """A plate hanging under the middle of its elbows, (4, N)."""
    middle = legs.elbows_mm.mean(axis=1)
    outward = legs.elbows_mm[:2] - middle[:2, None]
    drop2_mm2 = legs.forearm_mm**2 - (outward * outward).sum(axis=0)
    drop_mm = np.sqrt(np.maximum(drop2_mm2, 0.0).mean(axis=0))
    half_mm = 0.5 * legs.plate_mm
    return np.stack(
        [
            middle[0] + half_mm * np.sin(theta_rad),
            middle[1] - half_mm * np.cos(theta_rad),
            middle[2] - drop_mm + lift_mm,
            np.full_like(drop_mm, theta_rad),
        ]
    )


@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def _newton(legs: _Legs, start: Array, converged_mm: float) -> tuple[Array, Mask]:
    """Poses (4, N) and which of them passed the checks; singular rows are dropped."""
    poses = start.copy()
    good = np.zeros(poses.shape[1], dtype=bool)
    active = np.arange(poses.shape[1])
    some, current = legs, poses.copy()
    for _ in range(ITERATIONS):
        step, branch, misfit_mm = _newton_step(some, current)
        move_mm, turn_rad = np.abs(step[:3]).max(axis=0), np.abs(step[3])
        current += step / np.maximum(np.maximum(move_mm / STEP_MM, turn_rad / STEP_RAD), 1.0)
        size_mm = move_mm + LEVER_MM * turn_rad
        on_its_way = size_mm >= converged_mm
        if not on_its_way.all():
            assembled = (np.abs(misfit_mm) < MISFIT_OF_STEP * converged_mm).all(axis=0)
            hangs = current[2] < some.elbows_mm[2].mean(axis=0)
            wanted = hangs & (np.abs(current[3]) < 0.5 * np.pi) & (branch > 0.0)
            poses[:, active] = current
            good[active] = (size_mm < converged_mm) & assembled & wanted
            keep = on_its_way & np.isfinite(size_mm)
            if not keep.any():
                break
            active, current, some = active[keep], current[:, keep], some.rows(keep)
    return poses, good


def _newton_step(legs: _Legs, poses: Array) -> tuple[Array, Array, Array]:
    """Step (4, N), the branch's determinant (N,) and by how much forearms are too long, (4, N).

    The first two closures don't know θ: they leave one free direction, their forearms' normal,
    along which the other two are solved. This is the 4 x 4 system by hand, some ten times faster
    in batch.
    """
    sin, cos, h = np.sin(poses[3]), np.cos(poses[3]), legs.plate_mm
    w = poses[:3, None] - legs.elbows_mm
    w[0, 2:] -= h * sin
    w[1, 2:] += h * cos
    square = _dot(w, w)
    f = 0.5 * (square - legs.forearm_mm**2)
    w0, w1, last_two = w[:, 0], w[:, 1], w[:, 2:]
    normal, product = _cross(w0, w1), _dot(w0, w1)
    # the shortest step that satisfies the first two rows: it has no part along the normal
    part0, part1 = f[1] * product - f[0] * square[1], f[0] * product - f[1] * square[0]
    fixed = (part0 * w0 + part1 * w1) / _dot(normal, normal)
    by_theta = -h * (cos * last_two[0] + sin * last_two[1])
    by_free = _dot(last_two, normal[:, None])
    wanted = -f[2:] - _dot(last_two, fixed[:, None])
    determinant = by_free[0] * by_theta[1] - by_free[1] * by_theta[0]
    free = (wanted[0] * by_theta[1] - wanted[1] * by_theta[0]) / determinant
    turn = (by_free[0] * wanted[1] - by_free[1] * wanted[0]) / determinant
    step = np.concatenate([fixed + free * normal, turn[None]])
    return step, determinant, f / legs.forearm_mm


def _dot(a: Array, b: Array) -> Array:
    """Scalar products of vectors by component, (3, …)."""
    return np.asarray(np.einsum("k...,k...->...", a, b))


def _cross(a: Array, b: Array) -> Array:
    """Vector products of vectors by component, (3, N)."""
    return np.asarray(
        a.take(NEXT, axis=0) * b.take(LAST, axis=0) - a.take(LAST, axis=0) * b.take(NEXT, axis=0)
    )
