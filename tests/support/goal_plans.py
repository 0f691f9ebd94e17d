"""A plan large enough for goals, a cell whose tracker scatters, and σ by other code."""

from collections.abc import Sequence

import numpy as np
from fake_cell import COVARIANCE_MM2, NOMINAL, ROBOT, FakeCell
from par4_space import SPACE
from scipy.stats import chi2
from small_plans import work

from campaigns.estimation.least_squares import solve
from campaigns.estimation.residuals import PointResiduals, PositionModel
from campaigns.journal.records import Outcome
from campaigns.journal.views import AcceptedShot
from campaigns.measuring.stopping_rule import UncertaintyGoal
from campaigns.measuring.work import Work
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.planning.plans import PlanRequest, View, make_plan
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Pose

TRACKER_MM = (2500.0, 0.0, -500.0)
VIEW = View(TRACKER_MM, (1.0, 0.0, 0.0), np.radians(60.0))
REQUEST = PlanRequest(26, 2, 3, Pose(0.0, 0.0, -575.0, 0.0))
PLAN = make_plan(ROBOT, VIEW, REQUEST, np.random.default_rng(2))
ALL = frozenset(s.shot for s in PLAN)
OTHERS = frozenset(s.shot for s in PLAN if s.purpose is not ShotSet.IDENTIFICATION)
"""Validation and drift shots."""
STATED_STD_MM = COVARIANCE_MM2[0][0] ** 0.5
FREE = SPACE.places(SPACE.free_by_default)
LENGTHS = ~SPACE.is_angle[FREE]


def until(goal_mm: float | None, **changes: object) -> Work:
    goal = None if goal_mm is None else UncertaintyGoal(goal_mm)
    return work(PLAN, goal=goal, **changes)


def noisy_cell(
    seed: int = 1, std_mm: float = STATED_STD_MM, truth: Kinematics = NOMINAL
) -> FakeCell:
    """A cell whose tracker scatters; it states 0.01 mm whatever it does."""
    cell, rng = FakeCell(truth), np.random.default_rng(seed)
    exact_mm = cell.tracker.seen_mm

    def seen_mm():
        return tuple((np.array(exact_mm()) + std_mm * rng.standard_normal(3)).tolist())

    cell.tracker.seen_mm = seen_mm
    return cell


def numbers(shots: tuple[AcceptedShot, ...]) -> frozenset[int]:
    return frozenset(shot.intent.shot for shot in shots)


def worst_length_mm(shots: tuple[AcceptedShot, ...]) -> float:
    """σ of the worst length by all identification shots together, from a fit to its end.

    Multiplied by the scatter of the shots where chance does not explain it, once in 2000 times.
    """
    return worst_length_of([s.outcome for s in shots if s.intent.shot not in OTHERS])


def worst_length_of(outcomes: Sequence[Outcome]) -> float:
    """The same of these shots."""
    model = PositionModel(NOMINAL, FREE, np.array([each.joints for each in outcomes]))
    covariance = np.broadcast_to(np.array(COVARIANCE_MM2), (len(outcomes), 3, 3))
    points_mm = np.array([each.point_in_tracker_mm for each in outcomes])
    fit = solve(PointResiduals.from_points(model, points_mm, covariance))
    squares, dof = fit.residual @ fit.residual, len(fit.residual) - len(fit.x)
    factor2 = squares / dof if chi2.sf(squares, dof) < 0.0005 else 1.0
    of_all = np.linalg.inv(fit.jacobian.T @ fit.jacobian) * factor2
    return float(np.sqrt(np.diag(of_all)[: len(FREE)])[LENGTHS].max())
