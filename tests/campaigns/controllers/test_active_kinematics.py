"""Joints of a pose by the parameters in use, for a controller worked by hand."""

from math import radians

import numpy as np
import pytest

from campaigns.controllers.active_kinematics import joints_of_pose
from campaigns.kinematics.catalog import PAR4
from campaigns.kinematics.model import Kinematics
from campaigns.robots.robot import find_robot
from drivers.errors import LimitViolation
from drivers.values import Pose

FLAT = dict(find_robot("par4-prototype").robot.parameters)


def test_joints_of_a_pose_lead_back_to_it_by_the_parameters_in_use():
    changed = FLAT | {"arm0.joint_offset_deg": 1.0, "arm2.arm_mm": 351.0}
    joints = joints_of_pose(PAR4, changed, Pose(120.0, -80.0, -600.0, radians(20.0)))
    back = Kinematics.of(PAR4, changed).forward([joints]).values_or_raise()[0]
    assert back == pytest.approx([120.0, -80.0, -600.0, radians(20.0)], abs=1e-9)


def test_pose_out_of_reach_is_refused_with_its_numbers():
    with pytest.raises(
        LimitViolation, match=r"pose \(0\.000 mm, 0\.000 mm, -2000\.000 mm, 0\.000°\)"
    ):
        joints_of_pose(PAR4, FLAT, Pose(0.0, 0.0, -2000.0, 0.0))


def test_joints_come_to_a_pose_with_the_reading_of_the_side_they_come_from():
    lost = FLAT | {f"arm{arm}.backlash_deg": 0.2 for arm in range(4)}
    pose = Pose(120.0, -80.0, -600.0, radians(20.0))
    middle = np.array(joints_of_pose(PAR4, lost, pose))
    from_below = joints_of_pose(PAR4, lost, pose, present=middle - 0.1)
    from_above = joints_of_pose(PAR4, lost, pose, present=middle + 0.1)
    assert np.degrees(from_below - middle) == pytest.approx(0.1, abs=1e-9)
    assert np.degrees(from_above - middle) == pytest.approx(-0.1, abs=1e-9)
