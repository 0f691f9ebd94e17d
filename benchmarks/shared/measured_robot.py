"""The measured robot that solvers are compared on: 60 pairs, 120 shots, the errors of Table I."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.shared.prototype import FREE_PLACES, NOMINAL, SPACE
from campaigns.arrays import Array, Index
from campaigns.estimation.least_squares import Solution, solve
from campaigns.estimation.point_sets import distances_mm
from campaigns.estimation.residuals import DistanceResiduals, PointResiduals, PositionModel
from campaigns.mechanisms.mechanism import Kinematics

SHOTS = Path(__file__).parents[2] / "tests" / "data" / "vectors" / "table1-tracker-noise.csv"
VARIANCE_MM2 = 0.015**2 / 3.0


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredRobot:
    """Shots of one robot, two neighbours a pair."""

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

    def measured_mm(self) -> Array:
        """Distances of the pairs, (N/2,)."""
        return distances_mm(self.points_mm, *self.pairs.T)


def measured_robot() -> MeasuredRobot:
    """par4-prototype with Table I's errors, seen by a tracker with 0.015/√3 mm a coordinate."""
    shots = np.loadtxt(SHOTS, delimiter=",", skiprows=1)
    joints = np.radians(shots[:, 1:5])
    commanded = NOMINAL.forward(joints).values_or_raise()
    return MeasuredRobot(joints, shots[:, 5:], commanded)


def position_model(robot: MeasuredRobot, free: Index = FREE_PLACES) -> PositionModel:
    return PositionModel(NOMINAL, free, robot.joints, robot.commanded)


def distance_problem(robot: MeasuredRobot, free: Index = FREE_PLACES) -> DistanceResiduals:
    first, second = robot.pairs.T
    return DistanceResiduals.in_mm(position_model(robot, free), first, second, robot.measured_mm())


def point_problem(robot: MeasuredRobot, free: Index = FREE_PLACES) -> PointResiduals:
    covariance = np.broadcast_to(VARIANCE_MM2 * np.eye(3), (len(robot.points_mm), 3, 3))
    return PointResiduals.from_points(position_model(robot, free), robot.points_mm, covariance)


def by_distances(robot: MeasuredRobot, free: Index = FREE_PLACES) -> Array:
    """The identified parameters, (F,), 22 unless told."""
    return _parameters(solve(distance_problem(robot, free)), free)


def by_points(robot: MeasuredRobot, free: Index = FREE_PLACES) -> Array:
    """The identified parameters, (F,), 22 unless told."""
    return _parameters(solve(point_problem(robot, free)), free)


def _parameters(fit: Solution, free: Index) -> Array:
    assert fit.converged, fit.message
    return fit.x[: len(free)]


def printed_parameters(geometry: Kinematics) -> Array:
    """The 29 of the paper's eq. 1, mm and rad: all that a lab knows of."""
    return geometry.p[: len(SPACE.names)]
