"""Par4: four rotary arms and an articulated plate (paper eqs. 1-18, corrected in docs/model.md)."""

import numpy as np

from campaigns.arrays import Array
from campaigns.mechanisms.arms import RotaryArms
from campaigns.mechanisms.closed_chain import ClosedChain
from campaigns.mechanisms.configuration import Limbs
from campaigns.mechanisms.parasitic_rotation import LAST, NEXT
from campaigns.mechanisms.platforms import HingedPlate

FIRST_HALF = (0, 1)


class Par4(ClosedChain):
    """Closed chain whose first two closures don't know θ, which makes Newton's step short."""

    def __init__(self) -> None:
        super().__init__(
            "par4",
            RotaryArms,
            HingedPlate(shares=(0.0, 1.0)),
            held_fields=("azimuth_deg",),  # hypothesis (iii) of the paper
        )

    def assembly_sign(self, p: Array) -> Array:
        """Sign of the determinant at home, (1,): positive, as the elimination below forms it."""
        if self.platform.at_point == FIRST_HALF:
            return np.ones(1)
        return super().assembly_sign(p)

    def newton_step(self, limbs: Limbs, poses: Array) -> tuple[Array, Array, Array]:
        """Step (4, N), the determinant (N,) and by how much forearms are too long, (4, N).

        The first two closures don't know θ: they leave one free direction, their forearms' normal,
        along which the other two are solved. This is the 4 x 4 system by hand, some ten times
        faster in batch. Seen from half 2 it is the last two that don't, and nothing is saved.
        """
        if self.platform.at_point != FIRST_HALF:
            return super().newton_step(limbs, poses)
        sin, cos, h = np.sin(poses[3]), np.cos(poses[3]), limbs.platform[0]
        w = poses[:3, None] - limbs.elbows_mm
        w[0, 2:] -= h * sin
        w[1, 2:] += h * cos
        square = _dot(w, w)
        f = 0.5 * (square - limbs.forearm_mm**2)
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
        return step, determinant, f / limbs.forearm_mm


def _dot(a: Array, b: Array) -> Array:
    """Scalar products of vectors by component, (3, …)."""
    return np.asarray(np.einsum("k...,k...->...", a, b))


def _cross(a: Array, b: Array) -> Array:
    """Vector products of vectors by component, (3, N)."""
    return np.asarray(
        a.take(NEXT, axis=0) * b.take(LAST, axis=0) - a.take(LAST, axis=0) * b.take(NEXT, axis=0)
    )


PAR4 = Par4()
