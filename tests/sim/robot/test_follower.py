"""The simulated robot where a real controller's joints are."""

from math import radians

import numpy as np
import pytest

from sim.cell import Cell
from sim.errors import AssemblyLost
from sim.random_streams import WorkedTime
from sim.robot.follower import FollowingController
from sim.robot.linuxcnc_joints import JointsLost
from sim.scenarios.scenario import load_scenario

CENTRE = np.radians([20.0, 20.0, 20.0, 20.0])
ELSEWHERE = np.radians([35.0, 25.0, 15.0, 30.0])


class Joints:
    """Tells what a test says: one set of joints, or a list of them one after the other."""

    def __init__(self):
        self.now = CENTRE
        self.lost = False

    def read(self):
        if self.lost:
            raise JointsLost("lost", remedy="-")
        if isinstance(self.now, list):
            return self.now.pop(0) if len(self.now) > 1 else self.now[0]
        return self.now

    def close(self):
        pass


class Followed:
    """A robot that follows joints."""

    def __init__(self):
        cell = Cell(load_scenario("paper-simulation"))
        self.joints, self.slept_s, self.worked = Joints(), [], WorkedTime(0.0)
        self.robot = cell.robot
        self.controller = FollowingController(
            self.joints,
            cell.robot,
            geometry={"plate_mm": 100.0},
            speed_per_s=radians(180.0),
            worked=self.worked,
            sleep_s=self.slept_s.append,
        )


@pytest.fixture
def followed():
    return Followed()


def test_joints_that_have_come_to_rest_are_where_the_robot_arrives(followed):
    state = followed.controller.state(0.0)
    assert (state.joints, state.moving) == (tuple(CENTRE), False)
    assert np.array_equal(followed.robot.standing.encoders, CENTRE)


def test_joints_that_read_differently_a_moment_later_are_moving(followed):
    before = followed.robot.standing
    followed.joints.now = [CENTRE, CENTRE + 1e-4, CENTRE + 2e-4]
    state = followed.controller.state(0.0)
    assert state.moving
    assert state.joints == tuple(CENTRE + 1e-4)
    assert followed.robot.standing is before


def test_joints_that_stay_are_looked_at_once(followed):
    followed.controller.state(0.0)
    followed.slept_s.clear()
    arrived = followed.robot.standing
    followed.controller.encoders(1.0)
    assert followed.slept_s == []
    assert followed.robot.standing is arrived


def test_arm_works_for_the_way_it_goes(followed):
    followed.controller.state(0.0)
    before_s = followed.worked.seconds
    followed.joints.now = CENTRE + np.radians([18.0, 0.0, 0.0, 0.0])
    followed.controller.state(0.0)
    assert followed.worked.seconds - before_s == pytest.approx(0.1)


def test_robot_stands_where_it_was_while_the_joints_cannot_be_read(followed):
    followed.controller.state(0.0)
    followed.joints.lost = True
    state = followed.controller.state(1.0)
    assert (state.joints, state.moving) == (tuple(CENTRE), False)


def test_joints_that_jump_where_no_straight_way_leads_are_reached_all_the_same(followed):
    followed.joints.now = np.radians([45.0, 88.0, 65.0, -1.0])
    followed.controller.state(0.0)
    jumped = np.radians([8.0, -25.0, 65.0, 74.0])
    assert followed.robot.passable_part(jumped) < 1.0
    followed.joints.now = jumped
    assert not followed.controller.state(0.0).moving
    assert np.array_equal(followed.robot.standing.encoders, jumped)


def test_joints_at_which_no_robot_can_be_assembled_are_told(followed):
    followed.joints.now = np.radians([-179.0, 90.0, -179.0, 90.0])
    with pytest.raises(AssemblyLost, match="cannot be at joints"):
        followed.controller.state(0.0)


def test_geometry_is_the_scenarios(followed):
    assert followed.controller.geometry() == {"plate_mm": 100.0}
