"""How a controller counts, found from its own displays: units, frame, hand, and arms."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from campaigns.errors import ShotsInvalid
from campaigns.evaluation.controller_frame import DisplayedPoses, check_frame
from campaigns.robots.robot import find_robot

PAR4, DELTA = (find_robot(name).robot for name in ("par4-prototype", "delta"))
PLACES = np.array(
    [[0.0, 0.0, 0.0], [120.0, 40.0, -60.0], [-90.0, 130.0, 20.0], [30.0, -150.0, -110.0]]
)
TURNS = np.radians([0.0, 20.0, -25.0, 10.0])
TRACKER = Rotation.from_euler("zyx", [130.0, 3.0, -2.0], degrees=True)


def shown(robot, *, count=4, order, sign, unit, turned, scale=1.0, mirrored=False):
    """A controller's display: joints in its order and unit, poses in its turned frame."""
    poses = np.zeros((count, len(robot.mechanism.task)))
    poses[:, :3] = robot.workspace_centre[:3] + PLACES[:count]
    if poses.shape[1] > 3:
        poses[:, 3] = TURNS[:count]
    joints = robot.kinematics.inverse(poses).values_or_raise()
    raw = np.empty_like(joints)
    raw[:, list(order)] = sign * joints / unit
    frame = Rotation.from_euler("zyx", turned, degrees=True)
    its = frame.inv().apply(poses[:, :3] - np.array([5.0, -3.0, 40.0]))
    its *= np.array([1.0, 1.0, -1.0 if mirrored else 1.0]) / scale
    turn = -np.degrees(poses[:, 3:]) + 30.0
    points = TRACKER.apply(poses[:, :3]) + np.array([2000.0, 100.0, -300.0])
    return DisplayedPoses(np.hstack([its, turn]), raw, points)


@pytest.mark.parametrize(
    ("robot", "sign", "unit", "joints_in", "scale", "lengths_in"),
    [
        (PAR4, -1.0, 1.0, "rad", 1000.0, "m"),
        (DELTA, 1.0, np.pi / 180.0, "deg", 1.0, "mm"),
        pytest.param(PAR4, 1.0, np.pi / 180.0, "deg", 1.0, "mm", marks=pytest.mark.long),
    ],
    ids=["par4 in m", "delta", "par4"],
)
def test_units_frame_and_arms_are_found(robot, sign, unit, joints_in, scale, lengths_in):
    arms = len(robot.mechanism.joints)
    order = tuple(reversed(range(arms)))
    display = shown(robot, order=order, sign=sign, unit=unit, turned=[0.0, 0.0, 180.0], scale=scale)
    found = check_frame(robot.kinematics, display, "three.csv")
    assert found.problems == ()
    readings = {each.order: each for each in found.found}
    assert order in readings
    read = readings[order]
    assert (read.sign, read.joints_in, read.lengths_in) == (sign, joints_in, lengths_in)
    assert not read.mirrored
    np.testing.assert_allclose(read.rotation, np.diag([1.0, -1.0, -1.0]), atol=1e-6)
    np.testing.assert_allclose(read.origin_mm, [5.0, -3.0, 40.0], atol=1e-6)
    assert read.misfit_mm < 1e-6
    if robot is PAR4:
        assert read.turn == pytest.approx((-1.0, np.radians(30.0)))
    assert any("x is our x, y is our −y, z is our −z" in line for line in read.says())
    assert found.scale == pytest.approx(1.0)
    assert found.tracker_misfit_mm < 1e-6


def test_what_symmetry_cannot_tell_apart_is_named_with_its_frame_nearest_to_ours_first():
    display = shown(DELTA, order=(1, 2, 0), sign=1.0, unit=np.pi / 180.0, turned=[0.0, 0.0, 0.0])
    found = check_frame(DELTA.kinematics, display, "three.csv")
    assert found.found[0].order == (1, 2, 0)
    assert len(found.found) == 3  # of the others the frame is turned by 120°
    assert sum("as good" in line for line in found.says) == 2


def test_three_poses_do_not_tell_the_hand_and_say_so():
    display = shown(DELTA, count=3, order=(0, 1, 2), sign=1.0, unit=1.0, turned=[0.0, 0.0, 0.0])
    found = check_frame(DELTA.kinematics, display, "three.csv")
    assert (0, 1, 2) in {each.order for each in found.found}
    assert any("do not tell the hand" in each for each in found.problems)


def test_left_handed_frame_and_points_of_another_size_are_told():
    told = {"order": (0, 1, 2, 3), "sign": 1.0, "unit": 1.0, "turned": [0.0, 0.0, 0.0]}
    mirrored = check_frame(PAR4.kinematics, shown(PAR4, **told, mirrored=True), "three.csv")
    assert all(each.mirrored for each in mirrored.found)
    assert (0, 1, 2, 3) in {each.order for each in mirrored.found}
    assert any("mirrored against each other" in each for each in mirrored.problems)
    display = shown(PAR4, **told)
    display.points_mm[:] *= 1.1
    found = check_frame(PAR4.kinematics, display, "three.csv")
    assert any("1.100 times the displayed" in each for each in found.problems)


def test_joints_that_no_reading_explains_are_said():
    display = shown(PAR4, order=(0, 1, 2, 3), sign=1.0, unit=1.0, turned=[0.0, 0.0, 0.0])
    display.joints[:, 2] += 0.3
    found = check_frame(PAR4.kinematics, display, "three.csv")
    assert found.found == ()
    assert any("no reading explains the joints" in each for each in found.problems)
    line = DisplayedPoses(display.poses[[0, 0, 1]], display.joints[:3], None)
    with pytest.raises(ShotsInvalid, match="lie on a line"):
        check_frame(PAR4.kinematics, line, "three.csv")
