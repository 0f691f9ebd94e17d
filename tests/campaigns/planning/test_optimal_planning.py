"""Optimal plans for a campaign: what they hold, what they tell, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from par4_space import SPACE
from small_plans import VIEW, of

from campaigns.design import pose_sampling, tours
from campaigns.errors import PlanInvalid
from campaigns.estimation.information import predict_points
from campaigns.estimation.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.planning.optimal_plan import OptimalRequest, make_optimal_plan
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_check import Pace, check_plan
from campaigns.planning.plans import PlanRequest, View, joints_of, make_plan, pairs_of, poses_of
from campaigns.planning.predicted_uncertainty import plan_approach_shares
from campaigns.robots.robot import find_robot, pose_row
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Pose

pytestmark = pytest.mark.slow

ROBOT = find_robot("par4-prototype").robot
GEOMETRY, LIMITS = ROBOT.kinematics, ROBOT.limits
CENTRE = Pose(0.0, 0.0, -575.0, 0.0)
ROBOT_MODEL = RobotModel(GEOMETRY, LIMITS, pose_row(CENTRE))
LENGTH = ~SPACE.is_angle[SPACE.places(SPACE.free_by_default)]


def request(shots=40, *, drift=3, validation_pairs=10, **others):
    plan = PlanRequest(shots, validation_pairs, drift, CENTRE)
    asked = {"free": SPACE.free_by_default, "candidates": 400} | others
    return OptimalRequest(plan=plan, uncertainty=TrackerUncertainty(), **asked)


def planned(asked, view=VIEW, seed=1):
    """Shots, and what other numbers of them would give."""
    return make_optimal_plan(ROBOT, view, asked, np.random.default_rng(seed))


def worst_length_mm(shots, view=VIEW):
    shots = of(shots, ShotSet.IDENTIFICATION)
    poses = poses_of(shots)
    noise = point_covariance_mm2(poses[:, :3] - view.tracker_mm, TrackerUncertainty())
    found, _ = predict_points(GEOMETRY, SPACE.free_by_default, joints_of(shots), poses, noise)
    return np.sqrt(np.diag(found)[: len(LENGTH)])[LENGTH].max()


def travel(shots):
    joints = joints_of(shots)
    return tours.travel_rad(joints[:-1], joints[1:]).sum()


@pytest.fixture(scope="module")
def made():
    return planned(request(60))


@pytest.fixture(scope="module")
def plan(made):
    return made[0]


@pytest.fixture(scope="module")
def boundary_plan():
    return make_plan(ROBOT, VIEW, request(60).plan, np.random.default_rng(1))


def test_plan_holds_what_was_asked_for_in_different_poses_approached_from_both_sides(plan):
    counts = [len(of(plan, purpose)) for purpose in ShotSet]
    assert counts == [60, 20, 3, *[0] * (len(ShotSet) - 3)]
    assert [shot.shot for shot in plan] == list(range(83))
    assert len(pairs_of(plan, ShotSet.IDENTIFICATION)) == 30
    pairs = pairs_of(plan, ShotSet.IDENTIFICATION)
    assert (pairs[:, 1] == pairs[:, 0] + 1).sum() >= len(pairs) - 1
    poses = poses_of(of(plan, ShotSet.IDENTIFICATION))
    assert len(np.unique(poses, axis=0)) == len(poses)
    assert all(0.3 <= share <= 0.7 for share in plan_approach_shares(plan))


def test_plan_can_be_run_and_is_the_same_by_the_same_seed(plan):
    pace = Pace(1.0, 0.2, 1.0)
    assert check_plan(plan, ROBOT_MODEL, VIEW, pace).shots == plan
    assert planned(request(60))[0] == plan


def test_plan_tells_more_and_travels_less_than_the_boundary_plan(plan, boundary_plan):
    assert worst_length_mm(plan) < 0.8 * worst_length_mm(boundary_plan)
    assert travel(plan) < 0.9 * travel(boundary_plan)  # 0.82 to 0.89 by the seed


def test_plan_needs_no_validation_pairs_nor_a_tracker_that_sees_the_whole_workspace():
    near = View((1500.0, 1500.0, 0.0), (1500.0, 1500.0, 575.0), np.radians(12.0))
    asked = request(14, validation_pairs=0, drift=2, candidates=100)
    shots, _ = planned(asked, view=near)
    check_plan(shots, ROBOT_MODEL, near, Pace(1.0, 0.2, 1.0))
    assert [shot.purpose for shot in shots[::15]] == [ShotSet.DRIFT, ShotSet.DRIFT]
    assert len(shots) == 16


def test_curve_holds_the_plan_itself_among_fewer_and_more_shots(made):
    plan, curve = made
    shots = [count for count, _ in curve]
    assert shots == sorted(set(shots))
    assert shots[0] == 14
    assert 60 < shots[-1] <= 120
    lengths = {count: expected.largest("mm") for count, expected in curve}
    assert lengths[60] == pytest.approx(worst_length_mm(plan), rel=1e-6)
    assert [*lengths.values()] == sorted(lengths.values(), reverse=True)
    assert lengths[shots[0]] > 2.0 * lengths[60] > 2.0 * lengths[shots[-1]]


def test_goal_takes_as_few_shots_as_it_needs():
    found, _ = planned(request(60, until_mm=0.05))
    count = len(of(found, ShotSet.IDENTIFICATION))
    assert count < 30
    assert worst_length_mm(found) <= 0.05


def test_goals_out_of_reach_or_of_too_few_candidates_are_refused():
    asked = request(40, until_mm=0.001, candidates=100)
    with pytest.raises(PlanInvalid, match=r"σ=0\.001 .* 40 shots, .* leave ±0\.0") as refused:
        planned(asked)
    goal = float(refused.value.remedy.split("σ=")[1].split()[0])
    assert len(of(planned(replace(asked, until_mm=goal))[0], ShotSet.DRIFT)) == 3
    with pytest.raises(PlanInvalid, match="50 shots, the most allowed"):
        planned(request(1000, until_mm=0.001, candidates=50))


def test_fewer_candidates_than_shots_are_refused():
    with pytest.raises(PlanInvalid, match=r"120 shots .* only 100 candidates → ask for fewer"):
        planned(request(120, candidates=100))


def test_fewer_shots_than_tell_all_are_refused():
    with pytest.raises(PlanInvalid, match=r"12 shots .* 22 parameters .* 14 or"):
        planned(request(12))


def test_parameters_that_move_with_the_frame_are_refused():
    with pytest.raises(PlanInvalid, match=r"arm0\.x_mm.*--fix"):
        planned(request(free=(*SPACE.free_by_default, "arm0.x_mm")))


def test_view_that_sees_too_little_is_refused(monkeypatch):
    monkeypatch.setattr(pose_sampling, "BATCHES", 5)
    nearly_blind = replace(VIEW, acceptance_rad=np.radians(0.05))
    with pytest.raises(PlanInvalid, match="too small a part of the workspace"):
        planned(request(validation_pairs=0), view=nearly_blind)
