"""After a load the robot's own model places it elsewhere: it still finds its way."""

import numpy as np
import pytest
from bar_robots import robot_file

from campaigns.kinematics.model import Kinematics
from campaigns.planning.paths import RobotModel
from campaigns.robots.robot import find_robot


def model_of(tmp_path, shift_mm):
    """A hexapod whose identified base is beside the nominal one, and joints of its nominal edge."""
    robot = find_robot(str(robot_file(tmp_path, "hexapod"))).robot
    shifted = {f"arm{arm}.x_mm": robot.parameters[f"arm{arm}.x_mm"] + shift_mm for arm in range(6)}
    edge = np.array([[149.5, 0.0, -550.0, 0.0, 0.0, 0.0]])
    joints = robot.kinematics.inverse(edge).values[0]
    identified = Kinematics.of(robot.mechanism, dict(robot.parameters) | shifted)
    home = robot.workspace_centre
    return (
        RobotModel(identified, robot.limits, home),
        joints,
        identified.inverse(home[None]).values[0],
    )


@pytest.mark.parametrize("shift_mm", [6.0, 30.0])
def test_a_robot_at_a_limit_by_its_old_parameters_can_leave_by_its_new_ones(tmp_path, shift_mm):
    model, edge, home = model_of(tmp_path, shift_mm)
    assert model.kinematics.forward(edge[None]).values[0, 0] > 149.0 + shift_mm
    assert model.fault(edge, home) is None
    assert model.fault(home, edge) is not None, "and does not come back"
