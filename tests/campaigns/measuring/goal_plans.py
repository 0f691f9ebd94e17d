"""A plan large enough for goals, a cell whose tracker scatters, and σ as `identify` states it."""

from collections.abc import Sequence

import numpy as np
from fake_cell import CENTRE, COVARIANCE_MM2, NOMINAL, ROBOT, FakeCell
from small_plans import LIMITS, work

from campaigns.design.pose_sampling import sample_workspace
from campaigns.identification.identify import identify
from campaigns.identification.options import IdentificationOptions
from campaigns.journal.records import Outcome
from campaigns.journal.views import AcceptedShot
from campaigns.kinematics.model import Kinematics
from campaigns.measuring.work import Work
from campaigns.planning.plans import PlanRequest, View, make_plan
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import shots_of_outcomes
from drivers.values import Pose

TRACKER_MM = (2500.0, 0.0, -500.0)
VIEW = View(TRACKER_MM, (1.0, 0.0, 0.0), np.radians(60.0))
REQUEST = PlanRequest(26, 2, 3, Pose(0.0, 0.0, -575.0, 0.0))
PLAN = make_plan(ROBOT, VIEW, REQUEST, np.random.default_rng(2))
BY_NUMBER = {s.shot: s for s in PLAN}
ALL = frozenset(BY_NUMBER)
OTHERS = frozenset(s.shot for s in PLAN if s.purpose is not ShotSet.IDENTIFICATION)
"""Validation and drift shots."""
STATED_STD_MM = COVARIANCE_MM2[0][0] ** 0.5
WORKSPACE = sample_workspace(NOMINAL, LIMITS, CENTRE)


def until(goal_mm: float | None, **changes: object) -> Work:
    return work(PLAN, goal_mm=goal_mm, **changes)


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


def mean_std_mm(shots: Sequence[AcceptedShot]) -> float:
    """Mean σ of positions by all identification shots together, as `identify` states it."""
    return mean_std_of([s.outcome for s in shots if s.intent.shot not in OTHERS])


def mean_std_of(outcomes: Sequence[Outcome], nominal: Kinematics = NOMINAL) -> float:
    """The same of these shots."""
    planned = [BY_NUMBER[outcome.shot] for outcome in outcomes]
    shots = shots_of_outcomes(
        outcomes,
        nominal.mechanism,
        purposes=[shot.purpose for shot in planned],
        pairs=[shot.pair for shot in planned],
        targets=[shot.pose for shot in planned],
    )
    found = identify(nominal, shots, IdentificationOptions(workspace=WORKSPACE))
    return found.uncertainty.position_std_mm.mean
