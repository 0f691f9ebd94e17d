"""Robots, poses and derivatives by differences that the tests of the numerics share."""

import numpy as np
from family_cases import PAR4_REFERENCE, drawn, flat_in
from par4_space import SPACE, par4, par4_of, turning_limits

from campaigns.design.pose_sampling import FeasibleRegion
from campaigns.fit.rigid_transforms import from_paper_angles

CASES = PAR4_REFERENCE["cases"]


def geometry_in(document):
    return par4(flat_in(document))


NOMINAL = geometry_in(CASES["nominal"]["geometry"])
TABLE1 = geometry_in(CASES["nominal+table1"]["geometry"])
TILTS_RAD, SKEWS_RAD = (0.03, -0.02, 0.05, -0.04), (0.01, 0.004, -0.006, 0.02)
TILTED = par4_of(np.concatenate([TABLE1.p[: len(SPACE.names)], TILTS_RAD, SKEWS_RAD]))
"""Far more than a workshop would leave, so that no sign and no size goes unnoticed."""
LEVEL_ROBOTS = {"par4-prototype": NOMINAL, "par4-prototype + Table I": TABLE1}
ROBOTS = {**LEVEL_ROBOTS, "par4-prototype + Table I + axis tilts": TILTED}

LIMITS = turning_limits((-np.pi / 4, np.pi / 2), (-np.pi / 4, np.pi / 4), np.pi / 4)
CENTRE = np.array([0.0, 0.0, -575.0, 0.0])
TRACKER_MM = np.array([2500.0, 0.0, -600.0])
TRACKER_FROM_BASE = from_paper_angles(
    np.array([2.1, 0.02, -0.03]), np.array([2500.0, 400.0, 300.0])
)


def region(geometry=NOMINAL, limits=LIMITS, acceptance_rad=np.pi):
    facing = np.array([1.0, 0.0, 0.0])
    return FeasibleRegion(geometry, limits, CENTRE, TRACKER_MM, facing, acceptance_rad)


def reachable_poses(geometry, count, seed, limits=LIMITS):
    return drawn(region(geometry, limits), count, seed)


def reachable_joints(geometry, count, seed, limits=LIMITS):
    return geometry.inverse(reachable_poses(geometry, count, seed, limits)).values_or_raise()


def central_differences(function, x, steps):
    """∂function/∂x with one step for each x; the derivative's axis is the last."""
    columns = []
    for place, step in enumerate(steps):
        aside = np.zeros_like(x)
        aside[place] = step
        columns.append((function(x + aside) - function(x - aside)) / (2.0 * step))
    return np.stack(columns, axis=-1)
