"""A served cell: the real drivers over real sockets and a serial line."""

from functools import partial

import numpy as np
from robotline_layouts import PAR4_LAYOUT
from served_cell import ServedCell

from drivers.declaration import RobotSurroundings, Surroundings
from drivers.emscon.tracker import EmsconTracker
from drivers.ports import SystemClock
from drivers.robotline import LineRobot
from drivers.transport import opener_of
from drivers.values import Pose
from sim.cell import Cell
from sim.clock import ScaledClock
from sim.scenarios.scenario import load_scenario

SPEED_UP = 1000.0
PLACES = [Pose(60.0, -40.0, -620.0, 0.2), Pose(-80.0, 20.0, -560.0, -0.1)]


class Work:
    """Both devices of a served cell, connected by the real drivers."""

    def __init__(self, served):
        clock = SystemClock()
        opener = partial(opener_of(served.controller_url), timeout_s=1.0)
        self.robot = LineRobot(
            RobotSurroundings(open_transport=opener, layout=PAR4_LAYOUT, clock=clock)
        )
        opener = partial(opener_of(served.tracker_url), timeout_s=1.0)
        self.tracker = EmsconTracker(Surroundings(open_transport=opener, clock=clock))

    def __enter__(self):
        self.robot.connect()
        self.tracker.connect()
        self.tracker.prepare("CCR-1.5in", 0.5)
        return self

    def __exit__(self, *_):
        self.robot.close()
        self.tracker.close()

    def measured(self, pose):
        self.robot.move_pose(pose, 1.0)
        while self.robot.state().moving:
            pass
        return self.tracker.measure().point_in_tracker_mm


def test_the_same_cell_measures_the_same_over_sockets_and_serial_line():
    points = []
    for wire in ("tcp", "pty"):
        cell = Cell(load_scenario("realistic"))
        with (
            ServedCell(cell, ScaledClock(SPEED_UP), controller_on=wire) as served,
            Work(served) as work,
        ):
            points.append([work.measured(pose) for pose in PLACES])
    assert np.array_equal(points[0], points[1])
