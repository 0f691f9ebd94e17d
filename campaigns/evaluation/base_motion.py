"""Motion of the robot's base against nests beside it, from one campaign to another or to a check.

Nests have places in the base frame of each. Where all of them moved by one turn and shift it is the
base that moved, or what carries all nests; where they did not move as one body, nothing is told.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array
from campaigns.estimation import information
from campaigns.estimation.information import ChiSquareTest, chi_square_test, length_with_std
from campaigns.estimation.rigid_transforms import frame_jacobian
from campaigns.evaluation.decision import COVERAGE, Decision

FEWEST = 3
NestPlaces = tuple[tuple[str, ...], Array, Array]
"""Names of n nests, their places in the base frame (n, 3), and covariance (3 n, 3 n), in mm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseMotion:
    """Motion of the base since an older campaign, in its frame, with U (k = 2).

    The shift is that of the workspace's middle. Decision: pass where chance explains what nests
    show (`p` without any motion), fail where the base moved, not decided where they are no one body
    (`rigid_p`, None: so few are always one).
    """

    decision: Decision
    says: str
    nests: tuple[str, ...]
    moved_mm: float
    moved_u_mm: float
    turned_deg: float
    turned_u_deg: float
    shift_mm: tuple[float, float, float]
    p: float | None
    rigid_p: float | None


def base_motion(
    older: NestPlaces, newer: NestPlaces, about_mm: Array, common_mm2: Array | None = None
) -> BaseMotion | None:
    """Motion by the nests that both have, about a point (3,); None for fewer than three.

    `common_mm2` (3 n, 3 m) is the covariance of the older places with the newer ones, as those of a
    check have it by the parameters of its campaign; None: both are independent.
    """
    names = tuple(name for name in older[0] if name in newer[0])
    if len(names) < FEWEST:
        return None
    (before_mm, own), (after_mm, other) = (_only(names, each) for each in (older, newer))
    if common_mm2 is not None:
        rows = [3 * np.array([each[0].index(name) for name in names]) for each in (older, newer)]
        common = common_mm2[np.ix_(*((row[:, None] + np.arange(3)).ravel() for row in rows))]
        other = other - common - common.T
    root = np.linalg.cholesky(own + other)
    by_motion = -frame_jacobian(before_mm - about_mm).reshape(before_mm.size, -1)
    white = np.linalg.solve(root, by_motion)
    seen = np.linalg.solve(root, (after_mm - before_mm).ravel())
    found, covariance = np.linalg.lstsq(white, seen, rcond=None)[0], information.covariance(white)
    left = float(np.sum((seen - white @ found) ** 2))
    rigid = chi_square_test(left, seen.size - found.size)
    moved = chi_square_test(float(found @ np.linalg.solve(covariance, found)), found.size)
    turned_rad, turned_std_rad = length_with_std(found[:3], covariance[:3, :3])
    moved_mm, moved_std_mm = length_with_std(found[3:], covariance[3:, 3:])
    moved_u_mm, turned_u_rad = COVERAGE * moved_std_mm, COVERAGE * turned_std_rad
    decision, says = _answer(moved, rigid, f"{moved_mm:.3f} ± {moved_u_mm:.3f} mm")
    x_mm, y_mm, z_mm = found[3:].tolist()
    return BaseMotion(
        decision=decision,
        says=says,
        nests=names,
        moved_mm=moved_mm,
        moved_u_mm=moved_u_mm,
        turned_deg=float(np.degrees(turned_rad)),
        turned_u_deg=float(np.degrees(turned_u_rad)),
        shift_mm=(x_mm, y_mm, z_mm),
        p=moved.p,
        rigid_p=rigid.p,
    )


def _only(names: Sequence[str], places: NestPlaces) -> tuple[Array, Array]:
    """Places (n, 3) and covariance of some nests, by name."""
    rows = np.array([places[0].index(name) for name in names])
    every = (3 * rows[:, None] + np.arange(3)).ravel()
    return places[1][rows], places[2][np.ix_(every, every)]


def _answer(moved: ChiSquareTest, rigid: ChiSquareTest, size: str) -> tuple[Decision, str]:
    if rigid.beyond:
        return "not decided", "nests did not stay as one body: they say nothing about the base"
    if moved.beyond:
        return "fail", f"the base moved {size} against the nests"
    return "pass", f"the base stayed: by the nests it moved {size}"
