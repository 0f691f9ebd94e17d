"""Optimal plans for a campaign: what they hold, what they make known, and what is refused."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from small_plans import VIEW, of

from campaigns.errors import PlanInvalid
from campaigns.fit.error_model import ErrorModel
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.planning import optimal_plan
from campaigns.planning.forecast import Forecast, forecast, judged_positions
from campaigns.planning.optimal_plan import OptimalRequest, make_optimal_plan
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_check import Pace, PlanLimits, check_plan
from campaigns.planning.plans import PlanRequest, make_plan, pairs_of, poses_of
from campaigns.robots.robot import find_robot, pose_row
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Pose

ROBOT = find_robot("par4-prototype").robot
CENTRE = Pose(0.0, 0.0, -575.0, 0.0)
ROBOT_MODEL = RobotModel(ROBOT.kinematics, ROBOT.limits, pose_row(CENTRE))
MODEL, INSTRUMENT = ErrorModel(ROBOT.kinematics), TrackerUncertainty()
TRACKER_MM = np.array(VIEW.tracker_mm)
JUDGED = judged_positions(MODEL, ROBOT_MODEL, np.zeros((0, 4)))
FEW = 14


def request(shots=FEW, *, pairs=4, until_mm=None):
    plan = PlanRequest(shots, pairs, 3, CENTRE)
    return OptimalRequest(plan=plan, model=MODEL, uncertainty=INSTRUMENT, until_mm=until_mm)


def planned(asked, view=VIEW, seed=1):
    """Return a plan chosen among few candidates: choosing among all of them takes seconds."""
    with patch.object(optimal_plan, "CANDIDATES", 400):
        return make_optimal_plan(ROBOT, view, asked, np.random.default_rng(seed))


def foreseen(shots) -> Forecast:
    return forecast(shots, MODEL, TRACKER_MM, INSTRUMENT, JUDGED)


def mean_std_mm(shots) -> float:
    return float(foreseen(shots).position_std_mm.mean())


@pytest.fixture(scope="module")
def plan():
    return planned(request())


@pytest.fixture(scope="module")
def boundary_plan():
    return make_plan(ROBOT, VIEW, request().plan, np.random.default_rng(1))


def test_plan_holds_what_was_asked_for_in_different_poses_approached_from_both_sides(plan):
    counts = [len(of(plan, purpose)) for purpose in ShotSet]
    assert counts == [FEW, 8, 3, *[0] * (len(ShotSet) - 3)]
    assert [shot.shot for shot in plan] == list(range(FEW + 11))
    assert len(pairs_of(plan, ShotSet.IDENTIFICATION)) == FEW // 2
    poses = poses_of(of(plan, ShotSet.IDENTIFICATION))
    assert len(np.unique(poses, axis=0)) == len(poses)
    assert all(0.2 <= share <= 0.8 for share in foreseen(plan).from_below)


def test_plan_can_be_run_and_is_the_same_by_the_same_seed(plan):
    assert check_plan(plan, PlanLimits(ROBOT_MODEL, VIEW, Pace(1.0, 0.2, 1.0))).shots == plan
    assert planned(request()) == plan


def test_a_few_optimal_shots_make_more_known_than_those_of_the_boundary_plan(plan, boundary_plan):
    assert mean_std_mm(plan) < 0.7 * mean_std_mm(boundary_plan)


def test_goal_takes_as_few_shots_as_it_needs(plan):
    goal_mm = mean_std_mm(plan)
    found = planned(request(100, until_mm=goal_mm))
    count = len(of(found, ShotSet.IDENTIFICATION))
    assert count in (FEW - 2, FEW, FEW + 2)
    assert mean_std_mm(found) < 1.1 * goal_mm
    assert len(of(found, ShotSet.VALIDATION)) == 8


def test_goals_out_of_reach_are_refused_with_one_that_is_not():
    asked = request(FEW, until_mm=0.0001)
    with pytest.raises(PlanInvalid, match=rf"goal 0\.0001 mm .* {FEW} shots, .* leave") as refused:
        planned(asked)
    goal_mm = float(refused.value.remedy.split("ask for ")[1].split()[0])
    assert len(of(planned(replace(asked, until_mm=goal_mm)), ShotSet.DRIFT)) == 3
