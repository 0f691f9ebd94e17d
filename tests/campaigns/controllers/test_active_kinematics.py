"""Poses to joints and back with the set in use, for a controller that cannot do it."""

from math import radians

import pytest

from campaigns.controllers.active_kinematics import ActiveKinematics
from campaigns.kinematics.catalog import PAR4
from campaigns.robots.robot import find_robot
from drivers.errors import LimitViolation
from drivers.values import Pose

FLAT = dict(find_robot("par4-prototype").robot.parameters)
POSE = Pose(120.0, -80.0, -600.0, radians(20.0))


def test_pose_becomes_joints_by_the_parameters_and_the_joints_the_pose():
    active = ActiveKinematics(PAR4, FLAT)
    back = active.pose(active.joints(POSE))
    assert (back.x_mm, back.y_mm, back.z_mm) == pytest.approx((120.0, -80.0, -600.0), abs=1e-9)
    assert back.theta_rad == pytest.approx(radians(20.0), abs=1e-12)
    other = ActiveKinematics(PAR4, FLAT | {"arm0.joint_offset_deg": 1.0})
    first = ActiveKinematics(PAR4, FLAT).joints(POSE)
    assert other.joints(POSE)[0] == pytest.approx(first[0] - radians(1.0), abs=1e-12)


def test_what_cannot_be_taken_is_told_with_its_numbers():
    with pytest.raises(
        LimitViolation, match=r"pose \(0\.000 mm, 0\.000 mm, -2000\.000 mm, 0\.000°\)"
    ):
        ActiveKinematics(PAR4, FLAT).joints(Pose(0.0, 0.0, -2000.0, 0.0))
    broken = ActiveKinematics(PAR4, FLAT | {f"arm{arm}.forearm_mm": 10.0 for arm in range(4)})
    with pytest.raises(LimitViolation, match=r"joints \(0\.000°, 0\.000°, 0\.000°, 0\.000°\)"):
        broken.pose((0.0, 0.0, 0.0, 0.0))


def test_joints_come_to_a_pose_from_the_side_that_they_are_on():
    active = ActiveKinematics(PAR4, FLAT | {"arm0.backlash_deg": 0.1})
    middle, low, high = (radians(each) for each in (0.0, -0.05, 0.05))
    straight = active.joints(POSE)
    for here, expected in (
        (-1.0, high),
        (1.0, low),
        (low, low),
        (high, high),
        (middle - 1e-4, low),
    ):
        start = (straight[0] + here, *straight[1:])
        assert active.joints(POSE, start)[0] - straight[0] == pytest.approx(expected, abs=1e-12)
    assert active.joints(POSE, start)[1:] == pytest.approx(straight[1:], abs=1e-12)
