"""Plans as they are made: what they hold, where, and in which order."""

import re
from dataclasses import replace

import numpy as np
import pytest
from fake_cell import CENTRE, ROBOT
from small_plans import VIEW, of

from campaigns.errors import PlanInvalid
from campaigns.planning import plans
from campaigns.planning.plan_file import PlannedShot
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Pose, Vector3

MIDDLE = Pose(*CENTRE.tolist())
REQUEST = plans.PlanRequest(120, 20, 3, MIDDLE)


def plan(request: plans.PlanRequest = REQUEST, seed: int = 1, view: plans.View = VIEW):
    return plans.make_plan(ROBOT, view, request, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def default_plan() -> tuple[PlannedShot, ...]:
    return plan()


def test_default_plan_has_what_was_asked_for_in_pairs_with_drift_shots_between(
    default_plan: tuple[PlannedShot, ...],
) -> None:
    assert len(default_plan) == 120 + 40 + 3
    assert [shot.shot for shot in default_plan] == list(range(163))
    assert plans.pairs_of(default_plan, ShotSet.IDENTIFICATION).shape == (60, 2)
    assert plans.pairs_of(default_plan, ShotSet.VALIDATION).shape == (20, 2)
    for purpose in (ShotSet.IDENTIFICATION, ShotSet.VALIDATION):
        pairs = plans.pairs_of(default_plan, purpose)
        assert (np.diff(pairs, axis=1) == 1).all()
    assert [shot.shot for shot in of(default_plan, ShotSet.DRIFT)] == [0, 81, 162]
    assert {shot.pose for shot in of(default_plan, ShotSet.DRIFT)} == {MIDDLE}


@pytest.mark.parametrize(("pairs", "visits"), [(5, 3), (20, 3), (80, 9)])
def test_unless_told_the_drift_pose_is_visited_once_in_ten_pairs(pairs: int, visits: int) -> None:
    region, rows = plans.region_of(ROBOT, VIEW, MIDDLE), np.arange(2 * pairs).reshape(-1, 2)
    shots = plans.ordered_shots(region, np.tile(CENTRE, (2 * pairs, 1)), rows, 0, None)
    found = [shot.shot for shot in of(shots, ShotSet.DRIFT)]
    assert (len(found), found[0], found[-1]) == (visits, 0, len(shots) - 1)


def test_validation_shots_are_spread_over_the_workspace(
    default_plan: tuple[PlannedShot, ...],
) -> None:
    poses = plans.poses_of(of(default_plan, ShotSet.VALIDATION))
    assert (np.ptp(poses[:, :3], axis=0) > (500.0, 500.0, 250.0)).all()
    assert np.ptp(poses[:, 3]) > np.radians(60.0)


def test_planned_joints_keep_off_their_limits(default_plan: tuple[PlannedShot, ...]) -> None:
    low, high = ROBOT.limits.joint
    for purpose, reserve in (
        (ShotSet.IDENTIFICATION, plans.JOINT_RESERVE_RAD),
        (ShotSet.VALIDATION, plans.UNSEEN_JOINT_RESERVE_RAD),
    ):
        joints = plans.joints_of(of(default_plan, purpose))
        assert joints.min() >= low + reserve - 1e-12
        assert joints.max() <= high - reserve + 1e-12


def test_same_seed_gives_the_same_plan_also_without_validation_pairs() -> None:
    request = plans.PlanRequest(8, 2, 2, MIDDLE)
    assert plan(request, seed=3) == plan(request, seed=3)
    assert plan(request, seed=3) != plan(request, seed=4)
    shots = plan(plans.PlanRequest(8, 0, 2, MIDDLE))
    assert {shot.purpose for shot in shots} == {ShotSet.IDENTIFICATION, ShotSet.DRIFT}


def test_centre_out_of_reach_is_refused() -> None:
    with pytest.raises(PlanInvalid, match=r"centre \(0, 0, 100\) mm cannot be taken"):
        plan(replace(REQUEST, centre=Pose(0.0, 0.0, 100.0, 0.0)))


@pytest.mark.parametrize(
    ("place", "facing", "told"),
    [
        ((2.5, 0.0, -0.5), (1.0, 0.0, 0.0), "is in the robot.* as if it were given in metres"),
        ((250.0, 100.0, -600.0), (1.0, 0.0, 0.0), r"is in the robot.*\(limit 100 mm away\)$"),
        ((2500.0, 0.0, -500.0), (-1.0, 0.0, 0.0), "the reflector looks 178° away from the tracker"),
    ],
    ids=["in metres", "in the robot", "looks away"],
)
def test_tracker_that_cannot_stand_so_is_refused(
    place: Vector3, facing: Vector3, told: str
) -> None:
    with pytest.raises(PlanInvalid) as refused:
        plan(view=replace(VIEW, tracker_mm=place, facing=facing))
    assert re.search(told, refused.value.problem)
    assert "tracker.place_mm" in refused.value.remedy


@pytest.mark.parametrize("place", [(900.0, 0.0, -600.0), (0.0, 100.0, -2000.0), (0.0, 9e3, 2e3)])
def test_tracker_beside_below_or_above_the_robot_is_planned_with(place: Vector3) -> None:
    facing = tuple(there - here for there, here in zip(place, CENTRE.tolist()[:3], strict=True))
    request = replace(REQUEST, identification_shots=8, validation_pairs=1)
    assert len(plan(request, view=replace(VIEW, tracker_mm=place, facing=facing))) == 13


def test_workspace_that_is_too_small_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("campaigns.design.pose_sampling.BATCHES", 2)
    with pytest.raises(PlanInvalid, match="too small a part of the workspace"):
        plan(view=replace(VIEW, acceptance_rad=1e-4, facing=(2500.0, 0.0, 75.0)))
