"""A robot that stands in a forbidden place is only moved out of it."""

from pathlib import Path

import numpy as np
import pytest
from fake_cell import CENTRE, NOMINAL, FakeCell
from small_plans import FOUR_PAIRS, LIMITS, joints_at, work

from campaigns.design.restricted_space import Rectangle, RestrictedSpace, Zone
from campaigns.errors import JogRequired
from campaigns.planning.paths import RobotModel

FLOOR = Zone("space.z_lowest_mm -720", Rectangle(), (-720.0, np.inf), keeps_in=True)


SHELF = Zone("shelf", Rectangle(), (-725.0, -700.0), keeps_in=False)


def test_a_robot_below_the_floor_goes_up_and_measures(tmp_path: Path) -> None:
    cell = FakeCell()
    cell.robot.joints = joints_at(0.0, -100.0, -735.0, 0.0)
    robot = RobotModel(NOMINAL, LIMITS, CENTRE, RestrictedSpace((FLOOR,), 20.0, 5.0))
    cell.run(tmp_path, work(FOUR_PAIRS, robot=robot))


def test_a_robot_in_a_forbidden_place_without_a_way_out_is_not_moved(tmp_path: Path) -> None:
    cell = FakeCell()
    cell.robot.joints = joints_at(0.0, -100.0, -735.0, 0.0)
    robot = RobotModel(NOMINAL, LIMITS, CENTRE, RestrictedSpace((FLOOR, SHELF), 20.0, 5.0))
    with pytest.raises(JogRequired) as caught:
        cell.run(tmp_path, work(FOUR_PAIRS, robot=robot))
    assert caught.value.problem == (
        "no way to shot 0: the robot stands where it may not be: "
        "z -735 mm is below space.z_lowest_mm -720 with margin_mm 5"
    )
    assert len(cell.named("journal.intent")) == 1
    assert not cell.named("robot.move_joints")
