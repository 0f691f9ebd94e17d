"""Inner loops of residual stacks, compiled by numba: the extra `fast`.

Closures |B_i - A_i|² = L_i² of any mechanism come as numbers (`closure_coefficients.py`). Arrays of
one robot lie by component and shot, whose long rows the compiler turns into vector instructions; a
mechanism whose platform does not turn has one closure more, which holds that. Rows depend on no
other row.
"""

from collections.abc import Callable
from math import factorial
from typing import TypeAlias, TypeVar, cast

import numpy as np
from numba import njit

from campaigns.arrays import Array, Index, Mask
from campaigns.estimation import variance_components
from campaigns.estimation.gauss_newton import LEAST_PIVOT, LINEAR, NO_RESIDUAL
from campaigns.estimation.observability import RANK_TOLERANCE
from campaigns.estimation.rigid_transforms import rotation_entries
from campaigns.mechanisms.closed_chain import MISFIT_OF_STEP

Closed: TypeAlias = tuple[Array, Array, Array, Array, Index, Array, Array, Array]
"""Closures as `RobotStack.closed_at` has them, of all robots, or of one behind the functions."""
Function = TypeVar("Function", bound=Callable[..., object])
CLOSURES = 4
"""Of every mechanism here, and as many coordinates of a pose."""
GOOD_PIVOT = 1e-2
"""Least pivot by which one Cholesky loses four digits of sixteen."""
SYMMETRICAL = ((0, 0), (1, 1), (2, 2), (1, 0), (2, 0), (2, 1))
"""Entries of a symmetrical matrix."""
QUARTER = 0.5 * np.pi
COS_SERIES = tuple((-1.0) ** k / factorial(2 * k) for k in range(9))
SIN_SERIES = tuple((-1.0) ** k / factorial(2 * k + 1) for k in range(9))
"""Of powers of an angle's square: products are a tenth of the time of quotients."""
NEAR_MM = 1e-2
"""Step behind which the same inverse is as good: it leaves some 1e-5 of the next one."""
SETTLED_MM = 1e-4
"""Step by an inverse of its own that leaves as little as one of `CONVERGED_MM` by another's."""
NEWTON_STEPS = 10
"""More are left to the slower way, which also tries other guesses."""


def _compiled(function: Function) -> Function:
    """The function as machine code, kept on disk; sums may be taken in any order."""
    ways = {"cache": True, "error_model": "numpy", "fastmath": {"reassoc", "contract"}}
    return cast("Function", njit(**ways)(function))


@_compiled
def _cos_sin(angles: Array, cos: Array, sin: Array) -> None:
    """Cosines and sines (N,), by series within an eighth of a turn, in vector instructions."""
    for n in range(len(angles)):
        quarters = np.floor(angles[n] / QUARTER + 0.5)
        x = angles[n] - quarters * QUARTER
        y = x * x
        c = COS_SERIES[-1]
        s = SIN_SERIES[-1]
        for k in range(len(COS_SERIES) - 2, -1, -1):
            c = c * y + COS_SERIES[k]
            s = s * y + SIN_SERIES[k]
        s *= x
        halves = np.floor(0.5 * quarters)
        sign = 1.0 - 2.0 * (halves - 2.0 * np.floor(0.5 * halves))
        odd = quarters - 2.0 * halves
        cos[n] = sign * (c - odd * (c + s))
        sin[n] = sign * (s + odd * (c - s))


@_compiled
def _forearms(
    functions: Array,
    upper: Array,
    lower: Array,
    pose: Array,
    of_turns: Array,
    forearms: Array,
    by_turn: Array,
) -> None:
    """Forearms (4, 3, N), and the turn's part of the halved closures' derivatives (4, N).

    And cosines and sines of the turns, (2, N).
    """
    _, arms, shots = functions.shape
    _cos_sin(pose[3], of_turns[0], of_turns[1])
    for arm in range(arms):
        for axis in range(3):
            a0, a1, a2 = upper[arm, axis]
            b0, b1, b2, b3 = lower[arm, axis]
            for n in range(shots):
                end = b0 + b1 * pose[3, n] + b2 * of_turns[0, n] + b3 * of_turns[1, n]
                elbow = a0 + a1 * functions[1, arm, n] + a2 * functions[2, arm, n]
                forearms[arm, axis, n] = pose[axis, n] + end - elbow
        (_, x1, x2, x3), (_, y1, y2, y3), (_, z1, z2, z3) = lower[arm]
        for n in range(shots):
            cos, sin = of_turns[0, n], of_turns[1, n]
            along = forearms[arm, 0, n] * (x1 - x2 * sin + x3 * cos)
            along += forearms[arm, 1, n] * (y1 - y2 * sin + y3 * cos)
            by_turn[arm, n] = along + forearms[arm, 2, n] * (z1 - z2 * sin + z3 * cos)
    forearms[arms:] = 0.0
    by_turn[arms:] = 1.0


@_compiled
def _inverted(forearms: Array, by_turn: Array, inverse: Array, determinant: Array) -> None:
    """Inverses (4, 4, N) of the matrices with rows (forearm, turn's part), and determinants."""
    for n in range(len(determinant)):
        a0, a1, a2, a3 = forearms[0, 0, n], forearms[0, 1, n], forearms[0, 2, n], by_turn[0, n]
        b0, b1, b2, b3 = forearms[1, 0, n], forearms[1, 1, n], forearms[1, 2, n], by_turn[1, n]
        c0, c1, c2, c3 = forearms[2, 0, n], forearms[2, 1, n], forearms[2, 2, n], by_turn[2, n]
        d0, d1, d2, d3 = forearms[3, 0, n], forearms[3, 1, n], forearms[3, 2, n], by_turn[3, n]
        s01, s02, s03 = a0 * b1 - b0 * a1, a0 * b2 - b0 * a2, a0 * b3 - b0 * a3
        s12, s13, s23 = a1 * b2 - b1 * a2, a1 * b3 - b1 * a3, a2 * b3 - b2 * a3
        t01, t02, t03 = c0 * d1 - d0 * c1, c0 * d2 - d0 * c2, c0 * d3 - d0 * c3
        t12, t13, t23 = c1 * d2 - d1 * c2, c1 * d3 - d1 * c3, c2 * d3 - d2 * c3
        whole = s01 * t23 - s02 * t13 + s03 * t12 + s12 * t03 - s13 * t02 + s23 * t01
        determinant[n] = whole
        part = 1.0 / whole
        inverse[0, 0, n] = (b1 * t23 - b2 * t13 + b3 * t12) * part
        inverse[0, 1, n] = (a2 * t13 - a1 * t23 - a3 * t12) * part
        inverse[0, 2, n] = (d1 * s23 - d2 * s13 + d3 * s12) * part
        inverse[0, 3, n] = (c2 * s13 - c1 * s23 - c3 * s12) * part
        inverse[1, 0, n] = (b2 * t03 - b0 * t23 - b3 * t02) * part
        inverse[1, 1, n] = (a0 * t23 - a2 * t03 + a3 * t02) * part
        inverse[1, 2, n] = (d2 * s03 - d0 * s23 - d3 * s02) * part
        inverse[1, 3, n] = (c0 * s23 - c2 * s03 + c3 * s02) * part
        inverse[2, 0, n] = (b0 * t13 - b1 * t03 + b3 * t01) * part
        inverse[2, 1, n] = (a1 * t03 - a0 * t13 - a3 * t01) * part
        inverse[2, 2, n] = (d0 * s13 - d1 * s03 + d3 * s01) * part
        inverse[2, 3, n] = (c1 * s03 - c0 * s13 - c3 * s01) * part
        inverse[3, 0, n] = (b1 * t02 - b0 * t12 - b2 * t01) * part
        inverse[3, 1, n] = (a0 * t12 - a1 * t02 + a2 * t01) * part
        inverse[3, 2, n] = (d1 * s02 - d0 * s12 - d2 * s01) * part
        inverse[3, 3, n] = (c0 * s12 - c1 * s02 + c2 * s01) * part


@_compiled
def _misfits(forearms: Array, lengths: Array, misfit: Array) -> None:
    """Halved closures (4, N) of forearms (4, 3, N) and their lengths (n,)."""
    for arm in range(len(lengths)):
        half = 0.5 * lengths[arm] ** 2
        for n in range(misfit.shape[1]):
            x, y, z = forearms[arm, 0, n], forearms[arm, 1, n], forearms[arm, 2, n]
            misfit[arm, n] = 0.5 * (x * x + y * y + z * z) - half


@_compiled
def _is_wanted(
    functions: Array, upper: Array, limit_rad: float, sign: float, pose: Array, determinant: Array
) -> bool:
    """Whether platforms hang below their elbows, in the mode of home, and have not turned over."""
    arms, shots = len(upper), len(determinant)
    below, wanted = np.empty((1, shots)), 0
    for n in range(shots):
        below[0, n] = -arms * pose[2, n]
    for arm in range(arms):
        a, b, c = upper[arm, 2]
        for n in range(shots):
            below[0, n] += a + b * functions[1, arm, n] + c * functions[2, arm, n]
    for n in range(shots):
        is_turned = not abs(pose[3, n]) < limit_rad
        wanted += below[0, n] > 0.0 and determinant[n] * sign > 0.0 and not is_turned
    return wanted == shots


@_compiled
def assemble(
    functions: Array,
    upper: Array,
    lengths: Array,
    lower: Array,
    lever_mm: Array,
    limit_rad: Array,
    sign: Array,
    converged_mm: float,
    poses: Array,
) -> Mask:
    """Poses (R, 4, N) moved to those of the closures; which robots have all in the wanted mode."""
    (robots, _, shots), arms = poses.shape, functions.shape[1]
    found = np.zeros(robots, dtype=np.bool_)
    forearms, by_turn = np.empty((4, 3, shots)), np.empty((4, shots))
    inverse, determinant = np.empty((4, 4, shots)), np.empty(shots)
    misfit, step, of_turns = np.zeros((4, shots)), np.empty((4, shots)), np.empty((2, shots))
    for r in range(robots):
        pose, far, settled_mm = poses[r], 1, converged_mm
        for _ in range(NEWTON_STEPS):
            _forearms(functions, upper[r], lower[r], pose, of_turns, forearms, by_turn)
            _misfits(forearms, lengths[r], misfit)
            settled_mm = max(converged_mm, SETTLED_MM) if far else converged_mm
            if far:
                _inverted(forearms, by_turn, inverse, determinant)
            for axis in range(CLOSURES):
                for n in range(shots):
                    back = inverse[axis, 0, n] * misfit[0, n] + inverse[axis, 1, n] * misfit[1, n]
                    back += inverse[axis, 2, n] * misfit[2, n] + inverse[axis, 3, n] * misfit[3, n]
                    step[axis, n] = back
                    pose[axis, n] -= back
            underway = far = 0  # sums, for a maximum is formed one by one
            for n in range(shots):
                way = max(abs(step[0, n]), abs(step[1, n]), abs(step[2, n]))
                way += lever_mm[r] * abs(step[3, n])
                underway += not way < settled_mm
                far += not way < NEAR_MM
            if not underway:
                break
        found[r] = not underway and _is_wanted(
            functions, upper[r], limit_rad[r], sign[r], pose, determinant
        )
        beyond = 0
        for arm in range(arms):
            most_mm2 = MISFIT_OF_STEP * settled_mm * lengths[r, arm]
            for n in range(shots):
                beyond += not abs(misfit[arm, n]) < most_mm2
        found[r] &= beyond == 0
    return found


@_compiled
def _platform_column(
    by_lower: Array,
    pose: Array,
    of_turns: Array,
    forearms: Array,
    through: Array,
    place: int,
    jacobian: Array,
) -> None:
    """Derivatives (F, k, N) at a place by a parameter of the platform, as `_columns`."""
    closure = np.empty((1, pose.shape[1]))
    jacobian[place] = 0.0
    for arm in range(len(by_lower)):
        closure[:] = 0.0
        for axis in range(3):
            b0, b1, b2, b3 = by_lower[arm, axis]
            for n in range(closure.shape[1]):
                end = b0 + b1 * pose[3, n] + b2 * of_turns[0, n] + b3 * of_turns[1, n]
                closure[0, n] -= forearms[arm, axis, n] * end
        for row in range(len(through)):
            for n in range(closure.shape[1]):
                jacobian[place, row, n] += through[row, arm, n] * closure[0, n]


@_compiled
def _columns(
    functions: Array,
    by_upper: Array,
    owner: Index,
    own_mm: Array,
    by_lower: Array,
    pose: Array,
    of_turns: Array,
    forearms: Array,
    through: Array,
    jacobian: Array,
) -> None:
    """Derivatives (F, k, N) by the parameters of k values moved by closures, (k, 4, N).

    What a parameter adds to a halved closure, with the sign turned, times these.
    """
    shots = pose.shape[1]
    closure = np.empty((1, shots))
    for place in range(len(owner)):
        arm, own = owner[place], own_mm[place]
        if arm < 0:
            of_field = by_lower[-1 - arm]
            _platform_column(of_field, pose, of_turns, forearms, through, place, jacobian)
            continue
        (x0, x1, x2), (y0, y1, y2), (z0, z1, z2) = by_upper[place]
        for n in range(shots):
            first, second = functions[1, arm, n], functions[2, arm, n]
            along = own + forearms[arm, 0, n] * (x0 + x1 * first + x2 * second)
            along += forearms[arm, 1, n] * (y0 + y1 * first + y2 * second)
            closure[0, n] = along + forearms[arm, 2, n] * (z0 + z1 * first + z2 * second)
        for row in range(len(through)):
            for n in range(shots):
                jacobian[place, row, n] = through[row, arm, n] * closure[0, n]


@_compiled
def _whitened(whitening: Array, vectors: Array, out: Array) -> None:
    """Vectors (3, N) times lower triangular matrices (3, 3, N)."""
    w, (x, y, z) = whitening, vectors
    for n in range(len(x)):
        out[0, n] = w[0, 0, n] * x[n]
    for n in range(len(x)):
        out[1, n] = w[1, 0, n] * x[n] + w[1, 1, n] * y[n]
    for n in range(len(x)):
        out[2, n] = w[2, 0, n] * x[n] + w[2, 1, n] * y[n] + w[2, 2, n] * z[n]


_rotation_entries = _compiled(rotation_entries)


@_compiled
def turned(guesses: Array, angles_rad: Array) -> tuple[Array, Array]:
    """Rotations (R, 3, 3) turned by three small angles (R, 3), and derivatives (R, 3, 3, 3)."""
    rotations, by_angle = np.empty(guesses.shape), np.empty((len(guesses), 3, 3, 3))
    for r in range(len(guesses)):
        (z, y, x), guess = angles_rad[r], guesses[r]
        cos, sin = (np.cos(z), np.cos(y), np.cos(x)), (np.sin(z), np.sin(y), np.sin(x))
        entries = _rotation_entries(*cos, *sin)
        for i in range(3):
            a, b, c = guess[i]
            for j in range(3):
                rotations[r, i, j] = (
                    a * entries[0][0][j] + b * entries[0][1][j] + c * entries[0][2][j]
                )
                for k in range(3):
                    by = entries[k + 1]
                    by_angle[r, k, i, j] = a * by[0][j] + b * by[1][j] + c * by[2][j]
    return rotations, by_angle


@_compiled
def weighed_points(
    points_mm: Array,
    along_mm: float,
    along_per_mm: float,
    across_mm: float,
    across_per_mm: float,
    robot_scatter_mm: float,
) -> tuple[Array, Array, Array, bool]:
    """Points (R, N, 3) by component, (R, 3, N), and the covariances (R, N, 3, 3) of a tracker.

    And what whitens these, (R, 3, 3, N), as `point_covariance_mm2` and `inverse_roots`; whether all
    are positive definite.
    """
    robots, shots, _ = points_mm.shape
    by_component, covariance = np.empty((robots, 3, shots)), np.empty((robots, shots, 3, 3))
    whitening, finite = np.zeros((robots, 3, 3, shots)), True
    for r in range(robots):
        for n in range(shots):
            p, c, w = points_mm[r, n], covariance[r, n], whitening[r, :, :, n]
            distance = np.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
            along = (along_mm + along_per_mm * distance) ** 2
            across = (across_mm + across_per_mm * distance) ** 2
            for i in range(3):
                by_component[r, i, n] = p[i]
                for j in range(3):
                    c[i, j] = (along - across) * ((p[i] / distance) * (p[j] / distance))
                c[i, i] += across + robot_scatter_mm**2
            first = 1.0 / np.sqrt(c[0, 0])
            y, z = c[1, 0] * first, c[2, 0] * first
            second = 1.0 / np.sqrt(c[1, 1] - y * y)
            aside = (c[2, 1] - z * y) * second
            third = 1.0 / np.sqrt(c[2, 2] - z * z - aside * aside)
            w[0, 0], w[1, 1], w[2, 2] = first, second, third
            w[1, 0], w[2, 1] = -y * first * second, -aside * second * third
            w[2, 0] = (aside * y * second - z) * first * third
            finite &= bool(np.isfinite(first + second + third))
    return by_component, covariance, whitening, finite


@_compiled
def point_residuals(
    poses: Array, rotation: Array, shift_mm: Array, points_mm: Array, whitening: Array
) -> Array:
    """Whitened differences (R, 3 N) of turned and shifted poses (R, 4, N) from points."""
    robots, _, shots = poses.shape
    residuals, off_mm = np.empty((robots, 3, shots)), np.empty((3, shots))
    for r in range(robots):
        pose, measured = poses[r], points_mm[r]
        for axis in range(3):
            (a, b, c), shift = rotation[r, axis], shift_mm[r, axis]
            for n in range(shots):
                seen = a * pose[0, n] + b * pose[1, n] + c * pose[2, n] + shift
                off_mm[axis, n] = seen - measured[axis, n]
        _whitened(whitening[r], off_mm, residuals[r])
    return residuals.reshape(robots, 3 * shots)


@_compiled
def _normal(rows: Array, normal: Array) -> None:
    """Products of rows (P, M) with each other, a lower triangle (P, P), by four and three."""
    last = len(rows) - 1
    for a in range(0, len(rows), 4):
        a1, a2, a3 = min(a + 1, last), min(a + 2, last), min(a + 3, last)
        p, q, r, s = rows[a], rows[a1], rows[a2], rows[a3]
        for b in range(0, a3 + 1, 3):
            b1, b2 = min(b + 1, last), min(b + 2, last)
            x, y, z = rows[b], rows[b1], rows[b2]
            px = py = pz = qx = qy = qz = rx = ry = rz = sx = sy = sz = 0.0
            for n in range(len(p)):
                px += p[n] * x[n]
                py += p[n] * y[n]
                pz += p[n] * z[n]
                qx += q[n] * x[n]
                qy += q[n] * y[n]
                qz += q[n] * z[n]
                rx += r[n] * x[n]
                ry += r[n] * y[n]
                rz += r[n] * z[n]
                sx += s[n] * x[n]
                sy += s[n] * y[n]
                sz += s[n] * z[n]
            normal[a, b], normal[a, b1], normal[a, b2] = px, py, pz
            normal[a1, b], normal[a1, b1], normal[a1, b2] = qx, qy, qz
            normal[a2, b], normal[a2, b1], normal[a2, b2] = rx, ry, rz
            normal[a3, b], normal[a3, b1], normal[a3, b2] = sx, sy, sz


@_compiled
def _factored(normal: Array, root: Array) -> float:
    """Cholesky's root (P, P) of a lower triangle; its least pivot, 0 where there is none."""
    least, parts = np.inf, np.empty(len(normal))
    root[:] = 0.0
    for a in range(len(normal)):
        row = root[a]
        for b in range(a + 1):
            total, other = normal[a, b], root[b]
            for k in range(b):
                total -= row[k] * other[k]
            if b < a:
                row[b] = total * parts[b]
            elif total > 0.0:
                row[a] = np.sqrt(total)
                parts[a] = 1.0 / row[a]
                least = min(least, row[a])
            else:
                return 0.0
    return least


@_compiled
def _scaled_root(rows: Array, scale: Array, root: Array) -> float:
    """Root of the products of rows (P, M) made unit by `scale`; its least pivot."""
    normal = np.empty((len(rows), len(rows)))
    _normal(rows, normal)
    parts = np.empty(len(rows))
    for a in range(len(rows)):
        scale[a] = np.sqrt(normal[a, a]) if normal[a, a] > 0.0 else np.inf
        parts[a] = 1.0 / scale[a]
    for a in range(len(rows)):
        for b in range(a + 1):
            normal[a, b] *= parts[a] * parts[b]
    return _factored(normal, root)


@_compiled
def _step(
    rows: Array, residual: Array, norms: Array, root: Array, step: Array, change: Array
) -> tuple[float, bool]:
    """Gauss-Newton step of a Jacobian's columns (P, M), its length, and whether to trust it.

    The root of their products, and the change (M,) of residuals if the step is short enough to tell
    that.
    """
    regular = _scaled_root(rows, norms, root) > LEAST_PIVOT
    square = size = 0.0
    for n in range(len(residual)):
        size += residual[n] * residual[n]
    for a in range(len(rows)):
        total, row = 0.0, rows[a]
        for n in range(len(row)):
            total += row[n] * residual[n]
        total /= norms[a]
        for k in range(a):
            total -= root[a, k] * step[k]
        step[a] = total / root[a, a]
        square += step[a] * step[a]
    for a in range(len(rows) - 1, -1, -1):
        step[a] /= root[a, a]
        for k in range(a):
            step[k] -= root[a, k] * step[a]
        step[a] = -step[a] / norms[a]
    if square <= (2.0 * LINEAR) ** 2 * max(size, NO_RESIDUAL**2 * len(residual)):
        change[:] = 0.0
        for a in range(len(rows)):
            row, part = rows[a], step[a]
            for n in range(len(row)):
                change[n] += part * row[n]
    return np.sqrt(square), regular


@_compiled
def _room(shots: int) -> tuple[Array, Array, Array]:
    """Arrays to work in: forearms, inverses, and what closures move."""
    return np.empty((4, 3, shots)), np.empty((4, 4, shots)), np.empty((3, 4, shots))


@_compiled
def _point_jacobian(
    closed: Closed,
    rotation: Array,
    by_angle: Array,
    whitening: Array,
    room: tuple[Array, Array, Array],
    jacobian: Array,
) -> None:
    """The derivatives of one robot, (P, 3, N); in arrays that are worked in."""
    functions, upper, lower, by_upper, owner, own_mm, by_lower, pose = closed
    forearms, inverse, through = room
    shots = pose.shape[1]
    by_turn, determinant, of_turns = np.empty((4, shots)), np.empty(shots), np.empty((2, shots))
    turned, axes = np.empty((3, 3, shots)), np.empty((3, 3, shots))
    _forearms(functions, upper, lower, pose, of_turns, forearms, by_turn)
    _inverted(forearms, by_turn, inverse, determinant)
    for axis in range(3):
        for row in range(3):
            axes[axis, row] = rotation[row, axis]
        _whitened(whitening, axes[axis], turned[axis])
    for row in range(3):
        for arm in range(CLOSURES):
            for n in range(shots):
                along = turned[0, row, n] * inverse[0, arm, n]
                along += turned[1, row, n] * inverse[1, arm, n]
                through[row, arm, n] = along + turned[2, row, n] * inverse[2, arm, n]
    _columns(
        functions, by_upper, owner, own_mm, by_lower, pose, of_turns, forearms, through, jacobian
    )
    _frame_columns(by_angle, whitening, pose, jacobian[len(owner) :])


@_compiled
def _frame_columns(by_angle: Array, whitening: Array, pose: Array, jacobian: Array) -> None:
    """Whitened derivatives by a frame's angles and shift, (6, 3, N), or none, (0, 3, N)."""
    angles, shots = len(by_angle), pose.shape[1]
    turned = np.empty((3, shots))
    for axis in range(angles):
        for row in range(3):
            a, b, c = by_angle[axis, row]
            for n in range(shots):
                turned[row, n] = a * pose[0, n] + b * pose[1, n] + c * pose[2, n]
        _whitened(whitening, turned, jacobian[axis])
        for row in range(3):
            for n in range(shots):
                jacobian[angles + axis, row, n] = whitening[row, axis, n]


@_compiled
def point_jacobians(closed: Closed, rotation: Array, by_angle: Array, whitening: Array) -> Array:
    """Whitened derivatives of points by parameters and, if any angles, frames (R, P, 3, N)."""
    functions, upper, lower, by_upper, owner, own_mm, by_lower, poses = closed
    (robots, _, shots), free = poses.shape, len(owner)
    room = _room(shots)
    jacobians = np.empty((robots, free + 2 * by_angle.shape[1], 3, shots))
    for r in range(robots):
        own = upper[r], lower[r], by_upper[r], owner, own_mm[r], by_lower, poses[r]
        frame = rotation[r], by_angle[r], whitening[r]
        _point_jacobian((functions, *own), *frame, room, jacobians[r])
    return jacobians


@_compiled
def point_steps(
    closed: Closed, rotation: Array, by_angle: Array, whitening: Array, residual: Array
) -> tuple[Array, Array, Mask, Array, Array, Array]:
    """Steps (R, P) by these derivatives from residuals (R, 3 N), their lengths, which to trust.

    And how short ones change the residuals, (R, 3 N), norms of the derivatives (R, P), and roots
    (R, P, P) of their products when made unit. One robot after the other, so that its derivatives
    stay in the processor's cache.
    """
    functions, upper, lower, by_upper, owner, own_mm, by_lower, poses = closed
    (robots, _, shots), free = poses.shape, len(owner)
    room = _room(shots)
    jacobian = np.empty((free + 2 * by_angle.shape[1], 3, shots))
    unknowns, lengths = len(jacobian), np.empty(robots)
    steps, norms = np.empty((robots, unknowns)), np.empty((robots, unknowns))
    changes, roots = np.zeros(residual.shape), np.empty((robots, unknowns, unknowns))
    regular = np.empty(robots, dtype=np.bool_)
    for r in range(robots):
        own = upper[r], lower[r], by_upper[r], owner, own_mm[r], by_lower, poses[r]
        frame = rotation[r], by_angle[r], whitening[r]
        _point_jacobian((functions, *own), *frame, room, jacobian)
        rows = jacobian.reshape(unknowns, 3 * shots)
        found = norms[r], roots[r], steps[r], changes[r]
        lengths[r], regular[r] = _step(rows, residual[r], *found)
    return steps, lengths, regular, changes, norms, roots


@_compiled
def distance_residuals(
    poses: Array, first: Index, second: Index, measured_mm: Array, whitening: Array
) -> Array:
    """Whitened differences (R, M) of distances between shots `first` and `second` from measured."""
    residuals = np.empty(measured_mm.shape)
    for r in range(len(poses)):
        pose = poses[r]
        for m in range(len(first)):
            a, b = first[m], second[m]
            x, y, z = pose[0, b] - pose[0, a], pose[1, b] - pose[1, a], pose[2, b] - pose[2, a]
            off_mm = np.sqrt(x * x + y * y + z * z) - measured_mm[r, m]
            residuals[r, m] = whitening[r, m] * off_mm
    return residuals


@_compiled
def distance_jacobians(
    closed: Closed, first: Index, second: Index, whitening: Array, residual: Array
) -> tuple[Array, Array, Array, Mask, Array]:
    """Whitened derivatives (R, F, M) of distances between shots `first` and `second`.

    And what `point_steps` gives from residuals (R, M), if there are any.
    Each shot is an end of one distance at most.
    """
    functions, upper, lower, by_upper, owner, own_mm, by_lower, poses = closed
    (robots, _, shots), free = poses.shape, len(owner)
    forearms, inverse, _ = _room(shots)
    by_turn, determinant = np.empty((4, shots)), np.empty(shots)
    through, of_shots = np.zeros((1, 4, shots)), np.empty((free, 1, shots))
    jacobians, of_turns = np.empty((robots, free, len(first))), np.empty((2, shots))
    steps, lengths, changes = np.empty((robots, free)), np.empty(robots), np.zeros(residual.shape)
    norms, root, along = np.empty(free), np.empty((free, free)), np.zeros((3, shots))
    regular = np.zeros(robots, dtype=np.bool_)
    for r in range(robots):
        pose = poses[r]
        _forearms(functions, upper[r], lower[r], pose, of_turns, forearms, by_turn)
        _inverted(forearms, by_turn, inverse, determinant)
        for m in range(len(first)):
            a, b = first[m], second[m]
            x, y, z = pose[0, b] - pose[0, a], pose[1, b] - pose[1, a], pose[2, b] - pose[2, a]
            scale = whitening[r, m] / np.sqrt(x * x + y * y + z * z)
            along[0, b], along[1, b], along[2, b] = scale * x, scale * y, scale * z
            along[0, a], along[1, a], along[2, a] = -scale * x, -scale * y, -scale * z
        for arm in range(CLOSURES):
            for n in range(shots):
                moved = along[0, n] * inverse[0, arm, n] + along[1, n] * inverse[1, arm, n]
                through[0, arm, n] = moved + along[2, n] * inverse[2, arm, n]
        _columns(
            functions, by_upper[r], owner, own_mm[r], by_lower, pose, of_turns, forearms, through,
            of_shots,
        )  # fmt: skip
        for place in range(free):
            for m in range(len(first)):
                both = of_shots[place, 0, second[m]] + of_shots[place, 0, first[m]]
                jacobians[r, place, m] = both
        if len(residual):
            found = norms, root, steps[r], changes[r]
            lengths[r], regular[r] = _step(jacobians[r], residual[r], *found)
    return jacobians, steps, lengths, regular, changes


@_compiled
def _inverted_root(root: Array, norms: Array, inverse: Array) -> bool:
    """Inverse (P, P) of a lower root of products of rows that were made unit, these norms undone.

    Whether their rank is beyond doubt.
    """
    square = inverse_square = 0.0
    inverse[:] = 0.0
    for a in range(len(root)):
        inverse[a, a] = 1.0
        for k in range(a):
            for b in range(k + 1):
                inverse[a, b] -= root[a, k] * inverse[k, b]
        for b in range(a + 1):
            inverse[a, b] /= root[a, a]
            square += root[a, b] ** 2
            inverse_square += inverse[a, b] ** 2
    for b in range(len(root)):
        for a in range(b, len(root)):
            inverse[a, b] /= norms[b]
    return bool(square * inverse_square < RANK_TOLERANCE**-2)


@_compiled
def _orthonormal(rows: Array, norms: Array, root: Array, inverse: Array) -> bool:
    """Triangle (P, P) that makes rows (P, M) orthonormal; whether their rank is beyond doubt.

    By Cholesky's root of their products, made unit by norms, and by another one where rows are
    nearly alike, which is as exact as reflections where it is regular. Norms and root are changed.
    """
    least = np.diag(root).min()
    regular = _inverted_root(root, norms, inverse)
    if least >= GOOD_PIVOT:
        return regular
    size, again = np.empty(len(rows)), np.empty(root.shape)
    regular = least > LEAST_PIVOT and _scaled_root(inverse @ rows, size, again) > 0.5
    for a in range(len(rows)):
        for k in range(a + 1):
            root[a, k] *= size[k]
    return _inverted_root(root @ again, norms, inverse) and regular


@_compiled
def covariances(jacobians: Array) -> tuple[Array, Mask]:
    """Covariances (R, P, P) by Jacobians' columns (R, P, M), and whose rank is beyond doubt."""
    robots, unknowns, _ = jacobians.shape
    found, norms = np.empty((robots, unknowns, unknowns)), np.empty(unknowns)
    root, inverse = np.empty((unknowns, unknowns)), np.empty((unknowns, unknowns))
    regular = np.empty(robots, dtype=np.bool_)
    for r in range(robots):
        _scaled_root(jacobians[r], norms, root)
        regular[r] = _orthonormal(jacobians[r], norms, root, inverse)
        found[r] = inverse.T @ inverse
    return found, regular


@_compiled
def _score(products: Array, left: Array, leverage: Array) -> float:
    """Score of a component, as `component_score`, of symmetrical matrices (6, N) of the shots."""
    told = expected = square = 0.0
    for place in range(6):
        i, j = SYMMETRICAL[place]
        twice = 1.0 if i == j else 2.0
        own, by_fit, one, other = products[place], leverage[place], left[i], left[j]
        for n in range(len(own)):
            told += twice * own[n] * one[n] * other[n]
            expected -= twice * own[n] * by_fit[n]
            square += twice * own[n] * own[n]
        if i == j:
            for n in range(len(own)):
                expected += own[n]
    return float((told - expected) / np.sqrt(2.0 * square))


@_compiled
def _add_products(vectors: Array, products: Array) -> None:
    """Products of vectors (3, N) with themselves, added to symmetrical matrices (6, N)."""
    for n in range(products.shape[1]):
        x, y, z = vectors[0, n], vectors[1, n], vectors[2, n]
        products[0, n] += x * x
        products[1, n] += y * y
        products[2, n] += z * z
        products[3, n] += y * x
        products[4, n] += z * x
        products[5, n] += z * y


@_compiled
def point_scores(
    closed: Closed,
    rotation: Array,
    by_angle: Array,
    whitening: Array,
    slopes: Array,
    left: Array,
    norms: Array,
    roots: Array,
) -> tuple[Array, Mask, Array]:
    """Covariances as `covariances`, by the derivatives of points, and scores of components (2, R).

    `slopes` of the functions of the joints, (2, n, N); whitened residuals (R, 3 N). Norms (R, P)
    and roots (R, P, P) are those of the last step, which moved them by less than their rounding.
    """
    functions, upper, lower, by_upper, owner, own_mm, by_lower, poses = closed
    (robots, _, shots), free, arms = poses.shape, len(owner), functions.shape[1]
    room, unknowns = _room(shots), free + 2 * by_angle.shape[1]
    jacobian, column = np.empty((unknowns, 3, shots)), np.empty((3, shots))
    closure = np.empty((1, shots))
    basis, inverse = np.empty((unknowns, 3 * shots)), np.empty((unknowns, unknowns))
    found = np.empty((robots, unknowns, unknowns))
    regular, scores = np.empty(robots, dtype=np.bool_), np.empty((2, robots))
    leverage, products = np.empty((6, shots)), np.empty((6, shots))
    forearms, _, through = room
    for r in range(robots):
        own = upper[r], lower[r], by_upper[r], owner, own_mm[r], by_lower, poses[r]
        frame = rotation[r], by_angle[r], whitening[r]
        _point_jacobian((functions, *own), *frame, room, jacobian)
        rows = jacobian.reshape(unknowns, 3 * shots)
        regular[r] = _orthonormal(rows, norms[r].copy(), roots[r].copy(), inverse)
        found[r] = inverse.T @ inverse
        np.dot(inverse, rows, basis)
        leverage[:] = 0.0
        for a in range(unknowns):
            _add_products(basis[a].reshape(3, shots), leverage)
        by_shot = left[r].reshape(3, shots)
        products[:] = 0.0
        for axis in range(3):
            for row in range(3):
                column[row] = whitening[r, row, axis]
            _add_products(column, products)
        scores[0, r] = _score(products, by_shot, leverage)
        products[:] = 0.0
        for arm in range(arms):
            closure[:] = 0.0
            for axis in range(3):
                _, a, b = upper[r, arm, axis]
                for n in range(shots):
                    slope = a * slopes[0, arm, n] + b * slopes[1, arm, n]
                    closure[0, n] += forearms[arm, axis, n] * slope
            for row in range(3):
                for n in range(shots):
                    column[row, n] = through[row, arm, n] * closure[0, n]
            _add_products(column, products)
        scores[1, r] = _score(products, by_shot, leverage)
    return found, regular, scores


@_compiled
def unwhitened(whitening: Array, covariance_mm2: Array, vectors: Array) -> Array:
    """Vectors (k, 3, N) back in mm, by what (3, 3, N) whitens covariances C (N, 3, 3): W C Wᵀ = 1.

    The inverse of W is C Wᵀ.
    """
    back, out = np.empty(whitening.shape), np.empty(vectors.shape)
    for i in range(3):
        for j in range(3):
            x, y, z = whitening[j]
            for n in range(len(x)):
                along = covariance_mm2[n, i, 0] * x[n] + covariance_mm2[n, i, 1] * y[n]
                back[i, j, n] = along + covariance_mm2[n, i, 2] * z[n]
    for place in range(len(vectors)):
        x, y, z = vectors[place]
        for i in range(3):
            for n in range(len(x)):
                along = back[i, 0, n] * x[n] + back[i, 1, n] * y[n]
                out[place, i, n] = along + back[i, 2, n] * z[n]
    return out


@_compiled
def likelihood_rows(jacobian: Array, residual_mm: Array, by_joints: Array) -> tuple[Array, Array]:
    """Rows (P + 1, 3, N) of which likelihoods are formed, and covariances (3, 3, N) of joints.

    Of columns (P, 3, N), made unit, a misfit (3, N), and derivatives by the joints (n, 3, N).
    """
    unknowns, _, shots = jacobian.shape
    rows, through = np.empty((unknowns + 1, 3, shots)), np.zeros((3, 3, shots))
    rows[unknowns] = residual_mm
    for place in range(unknowns):
        square = 0.0
        for i in range(3):
            own = jacobian[place, i]
            for n in range(shots):
                square += own[n] * own[n]
        part = 1.0 / np.sqrt(square) if square > 0.0 else 1.0
        for i in range(3):
            for n in range(shots):
                rows[place, i, n] = jacobian[place, i, n] * part
    for joint in range(len(by_joints)):
        for i in range(3):
            for j in range(3):
                for n in range(shots):
                    through[i, j, n] += by_joints[joint, i, n] * by_joints[joint, j, n]
    return rows, through


@_compiled
def restricted_likelihood(
    rows: Array, stated_mm2: Array, through: Array, point_mm2: float, joint: float
) -> float:
    """2 log L of rows (P + 1, 3, N), the misfit's the last; not a number where that is lost.

    Covariances (3, 3, N) are as stated, with scatter of the points and `through` their joints.
    """
    unknowns, _, shots = rows.shape
    whitening, whitened, c = np.empty((3, 3, shots)), np.empty(rows.shape), np.empty((6, shots))
    for place in range(6):
        i, j = SYMMETRICAL[place]
        own = point_mm2 if i == j else 0.0
        for n in range(shots):
            c[place, n] = stated_mm2[i, j, n] + joint * through[i, j, n] + own
    for n in range(shots):
        first = 1.0 / np.sqrt(c[0, n])
        y, z = c[3, n] * first, c[4, n] * first
        second = 1.0 / np.sqrt(c[1, n] - y * y)
        across = (c[5, n] - z * y) * second
        third = 1.0 / np.sqrt(c[2, n] - z * z - across * across)
        whitening[0, 0, n], whitening[1, 1, n], whitening[2, 2, n] = first, second, third
        whitening[1, 0, n] = -y * first * second
        whitening[2, 1, n] = -across * second * third
        whitening[2, 0, n] = (across * y * second - z) * first * third
    logs = 0.0
    for n in range(shots):
        logs += np.log(whitening[0, 0, n] * whitening[1, 1, n] * whitening[2, 2, n])
    for place in range(unknowns):
        _whitened(whitening, rows[place], whitened[place])
    norms, root = np.empty(unknowns), np.empty((unknowns, unknowns))
    if not _scaled_root(whitened.reshape(unknowns, 3 * shots), norms, root) > LEAST_PIVOT:
        return np.nan
    size = -2.0 * logs
    for place in range(unknowns - 1):
        size += 2.0 * np.log(root[place, place] * norms[place])
    return float(-(size + (root[-1, -1] * norms[-1]) ** 2))


_begun, _next_trial, _with_trial = (
    _compiled(variance_components.begun),
    _compiled(variance_components.next_trial),
    _compiled(variance_components.with_trial),
)


@_compiled
def likeliest(
    rows: Array,
    stated_mm2: Array,
    through: Array,
    place: int,
    other: float,
    unit: float,
    low: float,
    high: float,
    tolerance: float,
) -> tuple[float, float]:
    """Largest 2 log L by the logarithm of one standard deviation between bounds, and where it is.

    The standard deviation is in parts of `unit`, the variance of the `other` component is fixed.
    Not a number where a likelihood is lost.
    """
    trial = low + variance_components.GOLDEN * (high - low)
    search, is_begun = _begun(low, high, trial, np.nan), False
    while not np.isnan(trial):
        own = (unit * np.exp(trial)) ** 2
        point_mm2, joint = (own, other) if place == 0 else (other, own)
        value = restricted_likelihood(rows, stated_mm2, through, point_mm2, joint)
        if np.isnan(value):
            return value, trial
        anew = _with_trial(search, trial, value)
        search = anew if is_begun else _begun(low, high, trial, value)
        search, trial = _next_trial(search, tolerance)
        is_begun = True
    return search[5], search[2]
