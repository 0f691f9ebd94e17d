"""Plans that were edited: each fault is named before anything moves."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from fake_cell import CENTRE, NOMINAL
from par4_space import SPACE
from small_plans import FOUR_PAIRS, LIMITS, OPEN, PACE, VIEW, planned

from campaigns.errors import PlanInvalid
from campaigns.planning import plan_check
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_check import CheckedPlan, PlanLimits, check_plan, seconds_of_visits
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import View
from campaigns.settings.sections import KnownLengthConfig
from campaigns.shots.shot_sets import ShotSet


def check(shots: tuple[PlannedShot, ...], view: View = VIEW, limits=LIMITS) -> CheckedPlan:
    return check_plan(shots, PlanLimits(RobotModel(NOMINAL, limits, CENTRE), view, PACE))


def with_shot(row: int, shot: PlannedShot) -> tuple[PlannedShot, ...]:
    return (*FOUR_PAIRS[:row], shot, *FOUR_PAIRS[row + 1 :])


def moved(row: int, **changes: float) -> tuple[PlannedShot, ...]:
    shot = FOUR_PAIRS[row]
    return with_shot(row, replace(shot, pose=replace(shot.pose, **changes)))


def problem(shots: tuple[PlannedShot, ...], view: View = VIEW) -> str:
    with pytest.raises(PlanInvalid) as caught:
        check(shots, view)
    assert "pkmcal plan" in caught.value.remedy
    return caught.value.problem


def test_good_plan_is_timed() -> None:
    checked = check(FOUR_PAIRS)
    assert checked.shots == FOUR_PAIRS
    assert checked.detours == 0
    joints = np.array([shot.joints for shot in FOUR_PAIRS])
    straight_rad = np.abs(np.diff(joints, axis=0)).max(axis=1).sum()
    assert checked.seconds == pytest.approx(straight_rad + 10 * 1.2)


def test_further_visits_of_the_drift_pose_take_the_time_that_plans_with_them_do() -> None:
    rows = range(1, len(FOUR_PAIRS) - 1)  # between two shots of pairs, not beside a drift shot
    drift = FOUR_PAIRS[0]
    longer = [
        check((*FOUR_PAIRS[: row + 1], drift, *FOUR_PAIRS[row + 1 :])).seconds
        for row in rows
        if ShotSet.DRIFT not in {shot.purpose for shot in FOUR_PAIRS[row : row + 2]}
    ]
    each_s = np.mean(longer) - check(FOUR_PAIRS).seconds
    assert len(longer) == 7
    assert seconds_of_visits(3, FOUR_PAIRS, NOMINAL, PACE) == pytest.approx(3 * each_s)


def test_pose_that_cannot_be_taken_is_named_with_its_reason() -> None:
    assert problem(moved(3, x_mm=1500.0)).startswith("shot 3: out of reach")
    assert "theta 51.566° outside [-45°, 45°]" in problem(moved(3, theta_rad=0.9))
    shots = with_shot(9, planned(9, ShotSet.DRIFT, None, 10.0, 0.0, -575.0))
    assert problem(shots) == "shot 9: its drift pose is not that of shot 0"


def test_pose_exactly_on_a_limit_is_good() -> None:
    _, limit = LIMITS.task[3]
    shot = planned(3, ShotSet.IDENTIFICATION, 1, 0.0, 0.0, -575.0, limit + 1e-12)
    check(with_shot(3, shot))


def test_edited_joint_is_named_with_what_the_pose_takes() -> None:
    shot = FOUR_PAIRS[4]
    q0, q1, q2, q3 = shot.joints
    edited = replace(shot, joints=(q0, q1, q2 + np.radians(0.05), q3))
    text = problem(with_shot(4, edited))
    expected = f"shot 4: q2_deg is {np.degrees(q2) + 0.05:.4f}, but its pose takes"
    assert text.startswith(expected)


def test_joints_of_the_other_branch_are_refused_though_they_lead_to_the_same_pose() -> None:
    """The inward elbow of arm 0: the same plate, other angles."""
    shot = FOUR_PAIRS[4]
    places = SPACE.places(["arm0.x_mm", "arm0.y_mm", "arm0.z_mm", "arm0.azimuth_deg"])
    *arm, azimuth_rad = NOMINAL.p[places]
    away = np.array([shot.pose.x_mm, shot.pose.y_mm, shot.pose.z_mm]) - arm
    outward_mm = away @ [np.cos(azimuth_rad), np.sin(azimuth_rad), 0.0]
    inward_rad = float(2.0 * np.arctan2(-away[2], outward_mm) - shot.joints[0])
    mirrored = replace(shot, joints=(inward_rad, *shot.joints[1:]))
    assert problem(with_shot(4, mirrored)).startswith("shot 4: q0_deg")


def test_reflector_turned_away_is_named_and_many_faults_counted() -> None:
    turned = replace(VIEW, facing=(2500.0, 1300.0, 75.0))
    text = problem(FOUR_PAIRS, turned)
    assert "reflector turned" in text
    assert "from the tracker, limit 25°" in text
    turned = replace(VIEW, facing=(-1.0, 0.0, 0.0))
    text = problem(FOUR_PAIRS, turned)
    assert text.count(" | ") == plan_check.FAULTS_NAMED - 1
    assert text.endswith("… and 5 more")


def test_nests_are_those_of_campaign_yaml_and_all_of_them() -> None:
    bar = KnownLengthConfig(name="bar", length_mm=500.0, std_mm=0.01, nests=("A", "B"))
    own = replace(FOUR_PAIRS[0], purpose=ShotSet.NEST)

    def faults(*nests: str, ends: tuple[str, str] = ("A", "B")) -> str:
        length = [replace(own, purpose=ShotSet.KNOWN_LENGTH, pair=9, nest=end) for end in ends]
        shots = (*FOUR_PAIRS, *length, *(replace(own, nest=name) for name in nests))
        with pytest.raises(PlanInvalid) as caught:
            check_plan(shots, PlanLimits(OPEN, VIEW, PACE, ("A", "B", "C"), (bar,)))
        return caught.value.problem

    assert faults() == "no shot measures nest C of campaign.yaml"
    assert "a known length is no pose of the robot" in faults("C", ends=("A", ""))
    assert faults("C", "D") == "shot 0: nest D is not among nests in campaign.yaml"
    assert faults("B", ends=("A", "C")) == "pair 9: no known length lies between nests A and C"
    assert faults("B", "C", ends=("A", "A")) == "pair 9: no known length lies between nests A and A"


def test_detours_are_counted() -> None:
    ends = [(-260.0, 60.0, -640.0, -0.7), (240.0, -300.0, -480.0, 0.7)]
    shots = tuple(
        planned(number, ShotSet.ROTATION, None, *pose) for number, pose in enumerate(ends * 2)
    )
    checked = check(shots)
    joints = np.array([shot.joints for shot in shots])
    ways = [OPEN.legs(a, b) for a, b in pairwise(joints)]
    assert [len(way) > 1 for way in ways] == [True] * checked.detours == [True] * 3
    legs = [leg for a, way in zip(joints, ways, strict=False) for leg in pairwise([a, *way])]
    travel_rad = sum(np.abs(b - a).max() for a, b in legs)
    assert checked.seconds == pytest.approx(travel_rad + len(shots) * 1.2)
