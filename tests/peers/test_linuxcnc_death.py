"""The real LinuxCNC dying behind its bridge, started anew, and another machine in its place."""

from math import radians

import pytest
from linuxcnc_bench import NEEDS_LINUXCNC, at, world_controller

from drivers.errors import DeviceRefused, DriverError, LinkDown, RobotStateUnknown

pytestmark = NEEDS_LINUXCNC

FAR_RAD = tuple(map(radians, (60.0, 55.0, 50.0, 45.0)))
NEAR_RAD = tuple(map(radians, (5.0, 5.0, 5.0, 5.0)))
SLOW = 0.05


@pytest.fixture
def linuxcnc(tmp_path):
    with world_controller(tmp_path) as running:
        yield running


@pytest.fixture
def bench(linuxcnc):
    with at(linuxcnc) as ready:
        yield ready


@pytest.mark.parametrize("program", ["milltask", pytest.param("rtapi_app", marks=pytest.mark.long)])
def test_program_that_dies_in_motion_is_noticed_and_no_stop_is_believed(bench, program):
    bench.started(FAR_RAD, SLOW)
    bench.linuxcnc.kill(program)
    assert "dead task or realtime part" in bench.faulty().fault
    with pytest.raises(RobotStateUnknown, match="hardware stop"):
        bench.robot.stop()


def test_task_that_died_at_rest_is_noticed_by_the_next_order(bench):
    bench.linuxcnc.kill("milltask")
    with pytest.raises(DriverError, match="takes no orders"):
        bench.robot.move_joints(NEAR_RAD, 1.0)
    with pytest.raises(RobotStateUnknown):
        bench.robot.stop()


def test_realtime_part_that_died_at_rest_counts_as_moving_and_no_stop_is_believed(bench):
    bench.linuxcnc.kill("rtapi_app")
    assert bench.robot.state().moving
    with pytest.raises(DeviceRefused):
        bench.robot.move_joints(NEAR_RAD, 1.0)
    with pytest.raises(RobotStateUnknown):
        bench.robot.stop()


def test_bridge_that_dies_takes_the_wire_with_it(bench):
    bench.started(FAR_RAD, SLOW)
    bench.linuxcnc.kill("python3")
    with pytest.raises(DriverError):
        bench.arrived()
    with pytest.raises(RobotStateUnknown):
        bench.robot.stop()


def test_controller_started_anew_has_to_be_made_ready_anew(linuxcnc, bench):
    bench.started(FAR_RAD, SLOW)
    linuxcnc.restart()
    with pytest.raises(LinkDown):
        bench.robot.state()
    bench.robot.stop()
    bench.robot.reconnect()
    assert bench.robot.state().emergency_stop
    with pytest.raises(DeviceRefused):
        bench.robot.move_joints(NEAR_RAD, 1.0)
    linuxcnc.make_ready()
    assert bench.move(NEAR_RAD).fault == ""


def test_other_kinematics_than_ours_has_no_parameters_and_takes_no_joints(tmp_path):
    edits = [
        ("KINEMATICS = pkmkins type=par4", "KINEMATICS = scarakins"),
        ("\nHALFILE = calib.hal", ""),
    ]
    with world_controller(tmp_path, edits=edits) as linuxcnc, at(linuxcnc) as bench:
        with pytest.raises(DeviceRefused, match="not a part of this robot"):
            bench.robot.read_geometry()
        with pytest.raises(DeviceRefused, match="no pkmkins here"):
            bench.robot.move_joints(NEAR_RAD, 1.0)
