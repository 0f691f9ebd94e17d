"""A served cell: real sockets to the real drivers, and nothing left when it is closed."""

import threading
from functools import partial

import numpy as np
import pytest
from robotline_layouts import PAR4_LAYOUT

from drivers.declaration import RobotSurroundings, Surroundings
from drivers.emscon.tracker import EmsconTracker
from drivers.errors import DriverError
from drivers.ports import SystemClock
from drivers.robotline import LineRobot
from drivers.transport import opener_of
from drivers.values import Pose
from sim.cell import Cell
from sim.clock import ScaledClock
from sim.embedded import EmbeddedCell
from sim.errors import SimError
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


def served_cell(name="realistic", **options):
    return EmbeddedCell(Cell(load_scenario(name)), ScaledClock(SPEED_UP), **options)


def test_the_same_cell_measures_the_same_over_sockets_and_serial_line():
    points = []
    for wire in ("tcp", "pty"):
        with served_cell(controller_on=wire) as served, Work(served) as work:
            points.append([work.measured(pose) for pose in PLACES])
    assert np.array_equal(points[0], points[1])


def test_memory_can_be_asked_for_while_the_cell_is_served_and_after():
    with served_cell() as served, Work(served) as work:
        work.measured(PLACES[0])
        during = served.memory()
    assert len(during["shots"]) == 1
    assert served.memory() == during


def test_closing_leaves_no_thread_and_nobody_at_the_urls():
    before = threading.active_count()
    with served_cell() as served:
        work = Work(served)
        work.robot.connect()
        served.close()
        with pytest.raises(DriverError):
            work.robot.state()
        with pytest.raises(DriverError):
            work.robot.connect()
    assert threading.active_count() == before


def test_a_taken_port_is_reported_and_leaves_nothing_open():
    with served_cell() as served:
        port = int(served.tracker_url.rsplit(":", 1)[1])
        with pytest.raises(SimError, match=str(port)):
            served_cell(tracker_port=port)
        with pytest.raises(SimError, match=str(port)):
            served_cell(controller_port=port)
