"""Whether the way between two poses is safe, and the way round."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from par4_cases import CENTRE, LIMITS, NOMINAL, reachable_joints
from small_plans import OPEN, joints_at

from campaigns.kinematics.model import Kinematics
from campaigns.planning.paths import RobotModel
from campaigns.robots.robot import find_robot


def turning_by(theta_rad):
    return replace(LIMITS, task=(None, None, None, (-theta_rad, theta_rad)))


def faults_between(joints):
    return [OPEN.fault(here, there) for here, there in pairwise(joints)]


@pytest.fixture(scope="module")
def joints():
    return reachable_joints(NOMINAL, 100, seed=71)


def test_a_short_way_at_the_centre_is_straight_and_none_at_all_is_safe():
    here, there = joints_at(-50, -50, -575, 0), joints_at(50, -20, -600, 0.2)
    assert OPEN.fault(here, there) is None
    (target,) = OPEN.legs(here, there)
    assert (target == there).all()
    here = joints_at(0, -50, -575, 0)
    assert OPEN.fault(here, here) is None


def test_a_way_through_an_infeasible_theta_is_named_and_gone_round_within_the_limits(joints):
    (low, high), faults = LIMITS.joint, faults_between(joints)
    blocked = [row for row, fault in enumerate(faults) if fault]
    assert "theta leaves its limits" in {faults[row][0] for row in blocked}
    rounds = [OPEN.legs(joints[row], joints[row + 1]) for row in blocked]
    found = [(row, way) for row, way in zip(blocked, rounds, strict=True) if way]
    assert len(found) > 0.9 * len(blocked)
    for row, way in found:
        assert len(way) > 1
        assert (way[-1] == joints[row + 1]).all()
        assert low <= np.min(way) <= np.max(way) <= high


def test_every_leg_of_a_way_round_is_safe_in_between(joints):
    """Checked five times finer than the planner checks."""
    low, high = LIMITS.task[3]
    for here, there in pairwise(joints[:30]):
        for a, b in pairwise([here, *OPEN.legs(here, there)]):
            passing = NOMINAL.forward(
                a + np.linspace(0.0, 1.0, 100)[:, None] * (b - a)
            ).values_or_raise()
            # samples of the planner are 5° of a joint apart: between them theta may bulge a little
            assert passing[:, 3].min() > low - np.radians(0.5)
            assert passing[:, 3].max() < high + np.radians(0.5)


def test_a_way_round_beyond_a_joint_limit_is_not_taken():
    """The shortest way round between these two would take joint 1 to -59.6°."""
    here, there = np.radians([[-37.5, -21.9, 69.8, 55.7], [82.9, -43.6, -39.8, 86.4]])
    middle = 0.5 * NOMINAL.forward(np.stack([here, there])).values_or_raise().sum(axis=0)
    assert np.degrees(joints_at(*middle)).min() == pytest.approx(-59.6, abs=0.1)
    (target, end) = OPEN.legs(here, there)
    assert np.degrees(target).min() > -45.0
    assert (end == there).all()


@pytest.mark.parametrize(
    ("limits", "reason"),
    [
        (turning_by(0.05), "theta leaves its limits"),
        (replace(LIMITS, forearm_swing_rad=0.0), "a forearm swings too far"),
    ],
)
def test_each_fault_of_a_way_is_named_with_the_part_where_it_begins(limits, reason):
    here, there = joints_at(0, -50, -575, 0), joints_at(150, 60, -575, 0.4)
    fault = RobotModel(NOMINAL, limits, CENTRE).fault(here, there)
    assert fault[0] == reason
    assert 0.0 < fault[1] < 1.0


def test_a_way_past_a_singularity_is_named():
    here, there = joints_at(0, -50, -575, 0), joints_at(0, -50, -575, 1.55)
    wide = replace(turning_by(2.0), forearm_swing_rad=1.5)
    fault = RobotModel(NOMINAL, wide, CENTRE).fault(here, there)
    assert fault[0] == "it passes near a singularity"
    assert fault[1] > 0.5


def test_a_way_where_the_mechanism_comes_apart_is_named_and_from_there_is_none():
    here, apart = joints_at(0, -50, -575, 0), np.radians([90.0, -90.0, 90.0, -90.0])
    fault = OPEN.fault(here, apart)
    assert fault[0] == "the mechanism cannot be assembled"
    apart, there = np.radians([90.0, -90.0, 90.0, -90.0]), joints_at(0, -50, -575, 0)
    assert OPEN.legs(apart, there) is None


def test_bars_whose_turn_a_coordinated_move_leaves_far_behind_go_straight_in_short_legs():
    """A fine pinion turns small differences of the joints' ways into large turns."""
    robot = find_robot("i4r").robot
    fine = Kinematics.of(robot.mechanism, dict(robot.parameters) | {"pinion_mm": 10.0})
    turned = np.radians(-88.5)
    ends = np.array([[-200.0, -200.0, -450.0, turned], [200.0, 200.0, -700.0, turned]])
    here, there = fine.inverse(ends).values_or_raise()
    model = RobotModel(fine, robot.limits, robot.workspace_centre)
    assert "theta leaves its limits" in model.fault(here, there)[0]
    way = model.legs(here, there)
    assert way is not None
    assert all(model.fault(one, other) is None for one, other in pairwise(np.array([here, *way])))


def judged_by(name, changes, **task):
    """Shipped robot with changed parameters, in mm or deg, and limits of task axes by name."""
    robot = find_robot(name).robot
    flat = dict(robot.parameters)
    changed = Kinematics.of(robot.mechanism, flat | {key: flat[key] + by for key, by in changes})
    axes = [axis.name for axis in robot.mechanism.task]
    limits = tuple(
        task.get(axis, limit) for axis, limit in zip(axes, robot.limits.task, strict=True)
    )
    limits = replace(robot.limits, task=limits)
    return robot, RobotModel(changed, limits, robot.workspace_centre)


def test_a_robot_that_a_load_has_placed_beyond_a_limit_is_led_back():
    """A new set places the standing robot elsewhere: 2 mm of the bars are 3.8° with this pinion."""
    robot, model = judged_by("i4r", (("arm2.x_mm", -2.0), ("arm3.x_mm", -2.0)))
    at_limit = np.array([[0.0, 0.0, -600.0, np.radians(89.9)]])
    (here,) = robot.kinematics.inverse(at_limit).values_or_raise()
    (pose,) = model.kinematics.forward(here[None]).values_or_raise()
    assert np.degrees(pose[3]) > 90.0 + 3.0
    (centre,) = model.kinematics.inverse(robot.workspace_centre[None]).values_or_raise()
    assert model.legs(tuple(here), tuple(centre)) == [tuple(centre)]
    beside = pose + np.array([50.0, 0.0, 0.0, 0.0])
    there = model.kinematics.inverse(beside + np.array([[0.0] * 4, [0.0, 0.0, 0.0, 0.02]]))
    way_there, way_beyond = (model.fault(here, end) for end in there.values_or_raise())
    assert way_beyond is not None, "no further"
    assert "theta" in way_beyond[0]
    assert model.legs(tuple(centre), tuple(there.values[0])) is None, "nor to such a place"
    assert way_there is None or way_there[1] > 0.0, "where it stands itself is no fault"


@pytest.mark.parametrize("kind", ["theta", "swing", "singular", "elbow"])
def test_each_margin_may_be_as_small_as_where_the_way_begins_and_no_smaller(kind):
    """Limits are drawn in to the middle of a way: back it is safe, on it is not."""
    here, there = joints_at(0, -50, -575, 0), joints_at(150, 60, -600, 0.4)
    part = np.array([0.0, 0.5, 0.6, 1.0])[:, None]
    joints = here + part * (there - here)
    poses = NOMINAL.forward(joints).values_or_raise()
    margins = NOMINAL.mechanism.margins(NOMINAL.p, joints, poses)
    limits = {
        "theta": lambda: turning_by(float(poses[1, 3])),
        "swing": lambda: replace(
            LIMITS, forearm_swing_rad=float(np.abs(margins.swing_rad[1]).max())
        ),
        "singular": lambda: replace(LIMITS, singularity_margin=float(margins.singular_value[1])),
        "elbow": lambda: replace(LIMITS, elbow_margin=float(margins.elbow[1])),
    }[kind]()
    model = RobotModel(NOMINAL, limits, CENTRE)
    assert model.fault(joints[2], joints[0]) is None, "back from beyond the limit"
    assert model.fault(joints[2], joints[3]) is not None, "no further"
    assert model.fault(joints[0], joints[2]) is not None, "nor there from within it"
