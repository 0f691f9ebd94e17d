"""Middle of a robot's reach: its workspace's centre where its file says none."""

from dataclasses import replace

import numpy as np
import pytest

from campaigns.errors import ConfigInvalid
from campaigns.robots.robot import RobotFile, find_robot


def of_unknown_centre(name: str, times: float = 1.0, aside_mm: float = 0.0) -> RobotFile:
    """A shipped robot of another size, elsewhere in its base frame, whose file says no centre."""
    robot = find_robot(name).robot
    space, joint = robot.mechanism.parameters, robot.mechanism.joints[0]
    values = {
        each: value * (times if space[each].unit == "mm" else 1.0)
        + (aside_mm if each.endswith(".x_mm") else 0.0)
        for each, value in robot.parameters.items()
    }
    scale = 1.0 if joint.is_revolute else times
    low, high = robot.limits.joint
    limits = replace(robot.limits, joint=(scale * low, scale * high))
    return RobotFile.of(robot.mechanism, values, name="odd", limits=limits)


@pytest.mark.parametrize(
    ("name", "times", "aside_mm"),
    [("par4-prototype", 1.0 / 3.0, 0.0), ("linear-delta", 1.0 / 3.0, 0.0), ("delta", 2.0, 300.0)],
)
def test_robot_of_any_size_and_place_reaches_all_about_its_centre(
    name: str, times: float, aside_mm: float
) -> None:
    robot = of_unknown_centre(name, times, aside_mm)
    centre = robot.workspace_centre
    np.testing.assert_allclose(centre[:2], [aside_mm, 0.0], atol=1e-9)
    around = np.tile(centre, (7, 1))
    around[1:4, :3] += 100.0 * times * np.eye(3)
    around[4:, :3] -= 100.0 * times * np.eye(3)
    assert robot.kinematics.feasibility(robot.limits, around).feasible.all()


def test_robot_that_reaches_nothing_is_refused() -> None:
    robot = of_unknown_centre("delta")
    short = dict(robot.parameters) | {f"arm{arm}.forearm_mm": 10.0 for arm in range(3)}
    lame = RobotFile.of(robot.mechanism, short, name="lame", limits=robot.limits)
    with pytest.raises(ConfigInvalid, match="reaches nothing"):
        _ = lame.workspace_centre
