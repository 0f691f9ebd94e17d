"""The measured robot that solvers are compared on: 60 pairs, 120 shots, the errors of Table I."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.estimation.least_squares import Solution, solve
from campaigns.estimation.point_sets import distances_mm
from campaigns.estimation.residuals import DistanceResiduals, PointResiduals, PositionModel
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.par4 import PAR4
from campaigns.robots.robot import find_robot

SHOTS = Path(__file__).parents[2] / "tests" / "data" / "vectors" / "table1-tracker-noise.csv"
VARIANCE_MM2 = 0.015**2 / 3.0
SPACE = PAR4.parameters
FREE = SPACE.places(SPACE.free_by_default)


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredRobot:
    """A robot's nominal geometry and its shots, two neighbours a pair."""

    nominal: Kinematics
    joints: Array
    """(N, 4)"""
    points_mm: Array
    """In the tracker's frame, (N, 3)."""
    commanded: Array
    """Where the controller believes to be, (N, 4): every contestant begins there."""

    @property
    def pairs(self) -> Index:
        """(N/2, 2)"""
        return np.arange(len(self.joints), dtype=np.intp).reshape(-1, 2)

    def of_shots(self, rows: slice) -> "MeasuredRobot":
        """With these shots only."""
        joints, points = self.joints[rows], self.points_mm[rows]
        return MeasuredRobot(self.nominal, joints, points, self.commanded[rows])

    def measured_mm(self) -> Array:
        """Distances of the pairs, (N/2,)."""
        first, second = self.pairs.T
        return distances_mm(self.points_mm, first, second)


def measured_robot() -> MeasuredRobot:
    """par4-prototype with Table I's errors, seen by a tracker with 0.015/√3 mm a coordinate."""
    shots = np.loadtxt(SHOTS, delimiter=",", skiprows=1)
    nominal = find_robot("par4-prototype").robot.kinematics
    joints = np.radians(shots[:, 1:5])
    commanded = nominal.forward(joints).values_or_raise()
    return MeasuredRobot(nominal, joints, shots[:, 5:], commanded)


def distance_problem(robot: MeasuredRobot) -> DistanceResiduals:
    first, second = robot.pairs.T
    model = PositionModel(robot.nominal, FREE, robot.joints, robot.commanded)
    return DistanceResiduals.in_mm(model, first, second, robot.measured_mm())


def point_problem(robot: MeasuredRobot) -> PointResiduals:
    covariance = np.broadcast_to(VARIANCE_MM2 * np.eye(3), (len(robot.points_mm), 3, 3))
    model = PositionModel(robot.nominal, FREE, robot.joints, robot.commanded)
    return PointResiduals.from_points(model, robot.points_mm, covariance)


def by_distances(robot: MeasuredRobot) -> Array:
    """The identified parameters, (22,)."""
    return _parameters(solve(distance_problem(robot)))


def by_points(robot: MeasuredRobot) -> Array:
    """The identified parameters, (22,)."""
    return _parameters(solve(point_problem(robot)))


def printed_parameters(geometry: Kinematics) -> Array:
    """The 29 of the paper's eq. 1, mm and rad: all that a lab knows of."""
    return geometry.p[: len(SPACE.names)]


def with_parameters(robot: MeasuredRobot, values: Array) -> Kinematics:
    """The nominal geometry with the identified parameters (22,) in place of its own."""
    return PositionModel(robot.nominal, FREE, robot.joints).kinematics(values)


def _parameters(fit: Solution) -> Array:
    assert fit.converged, fit.message
    return fit.x[: len(FREE)]


def largest_differences(one: Array, other: Array) -> tuple[float, float]:
    """The largest difference of two answers (22,): in a length, mm, and in an angle, deg."""
    off, angle = np.abs(one - other), SPACE.is_angle[FREE]
    return float(off[~angle].max()), float(np.degrees(off[angle].max()))
