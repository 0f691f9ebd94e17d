"""The simulated robot where a real controller's joints are."""

import numpy as np
import pytest

from sim.cell import Cell
from sim.errors import AssemblyLost
from sim.scenarios.scenario import load_scenario

CENTRE = np.radians([20.0, 20.0, 20.0, 20.0])


class Followed:
    """A robot that follows joints."""

    def __init__(self):
        self.cell = Cell(load_scenario("paper-simulation"))
        self.robot, self.controller = self.cell.robot, self.cell.controller

    def told(self, joints):
        self.controller.follow(joints)
        return self.controller.state(0.0)


@pytest.fixture
def followed():
    return Followed()


def test_joints_that_are_told_are_where_the_robot_arrives(followed):
    state = followed.told(CENTRE)
    assert (state.joints, state.moving) == (tuple(CENTRE), False)
    assert np.array_equal(followed.robot.standing.encoders, CENTRE)
    arrived = followed.robot.standing
    followed.controller.encoders(1.0)
    assert followed.robot.standing is arrived


def test_joints_that_jump_where_no_straight_way_leads_are_reached_all_the_same(followed):
    followed.told(np.radians([45.0, 88.0, 65.0, -1.0]))
    jumped = np.radians([8.0, -25.0, 65.0, 74.0])
    assert followed.robot.passable_part(jumped) < 1.0
    assert not followed.told(jumped).moving
    assert np.array_equal(followed.robot.standing.encoders, jumped)


def test_joints_at_which_no_robot_can_be_assembled_are_told(followed):
    with pytest.raises(AssemblyLost, match="cannot be at joints"):
        followed.told(np.radians([-179.0, 90.0, -179.0, 90.0]))
