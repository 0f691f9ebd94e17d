"""What a lab writes with SciPy to calibrate Par4: pose by pose, every derivative by differences.

The rival of `pkmcal`, and meant to be a fair one: a straightforward reading of the paper, with the
commanded poses to start from and nothing done twice. On purpose it shares no code with pkmcal. A
robot is 29 numbers: x, y, z, azimuth, joint offset, arm and forearm of each arm, then the plate's
length; all in mm and rad.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import fsolve, least_squares

Array = NDArray[np.float64]
Index = NDArray[np.intp]


def elbow(arm: Array, q: float) -> Array:
    x, y, z, azimuth, offset, length, _forearm = arm
    reach = length * np.cos(q + offset)
    drop = length * np.sin(q + offset)
    return np.array([x + reach * np.cos(azimuth), y + reach * np.sin(azimuth), z - drop])


def closures(pose: Array, elbows: list[Array], forearms: Array, plate: float) -> list[float]:
    """How much each forearm's squared length is off."""
    x, y, z, theta = pose
    first_half = np.array([x, y, z])
    second_half = first_half + plate * np.array([-np.sin(theta), np.cos(theta), 0.0])
    ends = [first_half, first_half, second_half, second_half]
    return [
        np.sum((end - start) ** 2) - forearm**2
        for end, start, forearm in zip(ends, elbows, forearms, strict=True)
    ]


def forward(robot: Array, joints: Array, start: Array) -> Array:
    """The pose X, Y, Z, theta of four joint angles."""
    arms, plate = robot[:28].reshape(4, 7), robot[28]
    elbows = [elbow(arm, q) for arm, q in zip(arms, joints, strict=True)]
    return np.asarray(fsolve(closures, start, args=(elbows, arms[:, 6], plate)))


def distance_errors(
    values: Array,
    robot: Array,
    free: Index,
    joints: Array,
    commanded: Array,
    pairs: Index,
    measured: Array,
) -> list[float]:
    changed = robot.copy()
    changed[free] = values
    points = [forward(changed, q, start)[:3] for q, start in zip(joints, commanded, strict=True)]
    return [
        float(np.linalg.norm(points[second] - points[first])) - distance
        for (first, second), distance in zip(pairs, measured, strict=True)
    ]


def identify(
    robot: Array, free: Index, joints: Array, commanded: Array, pairs: Index, measured: Array
) -> Array:
    """The free numbers of the robot (F,) from distances (M,) between pairs (M, 2) of shots."""
    found = least_squares(
        distance_errors,
        robot[free],
        method="lm",
        args=(robot, free, joints, commanded, pairs, measured),
    )
    return np.asarray(found.x)
