"""The measured robot that solvers are compared on: 60 pairs, 120 shots, the errors of Table I."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.estimation.least_squares import Solution, solve
from campaigns.estimation.point_sets import distances_mm
from campaigns.estimation.residuals import DistanceResiduals, PointResiduals, PositionModel
from campaigns.mechanisms.forward import forward
from campaigns.mechanisms.geometry import FREE_BY_DEFAULT, IS_ANGLE, NAMES, Geometry, indices
from campaigns.robots.robot import find_robot

SHOTS = Path(__file__).parents[2] / "tests" / "data" / "vectors" / "table1-tracker-noise.csv"
VARIANCE_MM2 = 0.015**2 / 3.0
FREE = indices(FREE_BY_DEFAULT)


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredRobot:
    """A robot's nominal geometry and its shots, two neighbours a pair."""

    nominal: Geometry
    joints_rad: Array
    """(N, 4)"""
    points_mm: Array
    """In the tracker's frame, (N, 3)."""
    commanded: Array
    """Where the controller believes to be, (N, 4): every contestant begins there."""

    @property
    def pairs(self) -> Index:
        """(N/2, 2)"""
        return np.arange(len(self.joints_rad), dtype=np.intp).reshape(-1, 2)

    def of_shots(self, rows: slice) -> "MeasuredRobot":
        """With these shots only."""
        joints, points = self.joints_rad[rows], self.points_mm[rows]
        return MeasuredRobot(self.nominal, joints, points, self.commanded[rows])

    def measured_mm(self) -> Array:
        """Distances of the pairs, (N/2,)."""
        first, second = self.pairs.T
        return distances_mm(self.points_mm, first, second)


def measured_robot() -> MeasuredRobot:
    """par4-prototype with Table I's errors, seen by a tracker with 0.015/√3 mm a coordinate."""
    shots = np.loadtxt(SHOTS, delimiter=",", skiprows=1)
    nominal = Geometry.from_flat(find_robot("par4-prototype").robot.geometry_flat())
    joints_rad = np.radians(shots[:, 1:5])
    commanded = forward(nominal, joints_rad).require()
    return MeasuredRobot(nominal, joints_rad, shots[:, 5:], commanded)


def distance_problem(robot: MeasuredRobot) -> DistanceResiduals:
    first, second = robot.pairs.T
    model = PositionModel(robot.nominal, FREE, robot.joints_rad, robot.commanded)
    return DistanceResiduals(model, first, second, robot.measured_mm())


def point_problem(robot: MeasuredRobot) -> PointResiduals:
    covariance = np.broadcast_to(VARIANCE_MM2 * np.eye(3), (len(robot.points_mm), 3, 3))
    model = PositionModel(robot.nominal, FREE, robot.joints_rad, robot.commanded)
    return PointResiduals.from_points(model, robot.points_mm, covariance)


def by_distances(robot: MeasuredRobot) -> Array:
    """The identified parameters, (22,)."""
    return _parameters(solve(distance_problem(robot)))


def by_points(robot: MeasuredRobot) -> Array:
    """The identified parameters, (22,)."""
    return _parameters(solve(point_problem(robot)))


def printed_parameters(geometry: Geometry) -> Array:
    """The 29 of the paper's eq. 1, mm and rad: all that a lab knows of."""
    return geometry.vector()[: len(NAMES)]


def with_parameters(robot: MeasuredRobot, values: Array) -> Geometry:
    """The nominal geometry with the identified parameters (22,) in place of its own."""
    return PositionModel(robot.nominal, FREE, robot.joints_rad).geometry(values)


def _parameters(fit: Solution) -> Array:
    assert fit.converged, fit.message
    return fit.x[: len(FREE)]


def largest_differences(one: Array, other: Array) -> tuple[float, float]:
    """The largest difference of two answers (22,): in a length, mm, and in an angle, deg."""
    off, angle = np.abs(one - other), IS_ANGLE[FREE]
    return float(off[~angle].max()), float(np.degrees(off[angle].max()))
