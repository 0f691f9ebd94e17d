"""Evidence that Table I as printed is no usable robot (docs/model.md, erratum 3)."""

from dataclasses import dataclass

import numpy as np

from app.papers.corbel2006.printed import LINES_MM
from campaigns.arrays import Array, Mask
from campaigns.robots.robot import RobotFile, find_robot

GRID_MM = 25.0
EXTENT_MM = 1000.0
"""The grid reaches so far to every side of the base: further than any of the robots."""
PRINTED_LIMITS_RAD = (-np.pi / 4.0, np.pi / 4.0)


@dataclass(frozen=True, slots=True, eq=False)
class Reach:
    """What of a grid over the whole space a robot reaches at θ = 0."""

    name: str
    points_mm: Array
    """Those that it reaches, (N, 3)."""
    lines_mm: tuple[float, float, float]
    """The longest straight lines along x, y and z anywhere on the grid."""

    @property
    def does_lines(self) -> bool:
        """Whether the three lines of section IV.E would fit somewhere, each for itself."""
        return all(has >= asked for has, asked in zip(self.lines_mm, LINES_MM, strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class GridJoints:
    """The joints of a robot at every point of the grid; NaN where it has none."""

    points_mm: Array
    """(K, K, K, 3), along x, y and z."""
    joints: Array
    """(K, K, K, 4)"""


def reaches() -> tuple[Reach, ...]:
    """As printed and our reading, each with the printed joint limits and with ours."""
    ours_rad = find_robot("par4-prototype").robot.limits.joint
    limits = (("±45°", PRINTED_LIMITS_RAD), ("−45° to 90°", ours_rad))
    return tuple(
        reach_of(f"{name}, {words}", grid, limits_rad)
        for name, grid in (
            ("par4-table1 (printed)", grid_joints(find_robot("par4-table1").robot)),
            ("par4-prototype", grid_joints(find_robot("par4-prototype").robot)),
        )
        for words, limits_rad in limits
    )


def grid_joints(robot: RobotFile) -> GridJoints:
    """Whatever a robot's limits are."""
    axis = np.arange(-EXTENT_MM, EXTENT_MM + GRID_MM / 2.0, GRID_MM)
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    poses = np.zeros((axis.size**3, 4))
    poses[:, :3] = points.reshape(-1, 3)
    joints = robot.kinematics.inverse(poses).values
    return GridJoints(points, joints.reshape(*points.shape[:3], 4))


def reach_of(name: str, grid: GridJoints, joint_limits_rad: tuple[float, float]) -> Reach:
    """Only joints count: neither swing nor singularities, so this is generous."""
    low, high = joint_limits_rad
    within = (grid.joints >= low) & (grid.joints <= high)  # NaN is not
    reached: Mask = np.asarray(within.all(axis=-1))
    x, y, z = (_longest_mm(np.moveaxis(reached, which, -1)) for which in range(3))
    return Reach(name, grid.points_mm[reached], (x, y, z))


def misfit_in_words(printed: Reach) -> str:
    """What follows for the robot as printed."""
    lines = ", ".join(f"{length:g}" for length in printed.lines_mm)
    asked = ", ".join(f"{length:g}" for length in LINES_MM)
    return (
        f"With the azimuths, lengths and joint limits that the paper prints, the robot reaches "
        f"{len(printed.points_mm)} points of the grid, and straight lines along x, y and z of at "
        f"most {lines} mm anywhere; the tests of section IV.E need {asked} mm. The arms swing "
        f"sideways, and the forearms are too short. What we read instead, and how what the paper "
        f"measured decides it: docs/model.md, errata."
    )


def _longest_mm(grid: Mask) -> float:
    """The longest unbroken run along the last axis, from its first point to its last."""
    run = np.zeros(grid.shape[:-1], dtype=np.intp)
    longest = 0
    for place in range(grid.shape[-1]):
        run = np.where(grid[..., place], run + 1, 0)
        longest = max(longest, int(run.max()))
    return GRID_MM * max(longest - 1, 0)
