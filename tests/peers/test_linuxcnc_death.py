"""The real LinuxCNC dying behind its port, started anew, and another machine in its place."""

import time
from math import radians

import pytest
from linuxcnc_bench import (
    NEEDS_LINUXCNC,
    SEEN_WITHIN_S,
    SHORT,
    Bench,
    at,
    joints_controller,
    world_controller,
)

from drivers.errors import DeviceRefused, DriverError, LinkDown, RobotStateUnknown, WrongDevice
from drivers.linuxcnc.settings import Coordinates

pytestmark = NEEDS_LINUXCNC

FAR_RAD = tuple(map(radians, (60.0, -30.0, 45.0, 20.0)))
NEAR_RAD = tuple(map(radians, (5.0, 5.0, 5.0, 5.0)))
SLOW = 0.05


@pytest.fixture
def bench(tmp_path):
    with joints_controller(tmp_path) as linuxcnc, at(linuxcnc, deadlines=SHORT) as ready:
        yield ready


def wait_for_fault(bench):
    deadline_s = time.monotonic() + SEEN_WITHIN_S
    while not (state := bench.robot.state()).fault:
        assert time.monotonic() < deadline_s, state
        time.sleep(0.02)
    return state.fault


@pytest.mark.parametrize("program", ["milltask", pytest.param("rtapi_app", marks=pytest.mark.long)])
def test_program_that_dies_in_motion_is_noticed_and_no_stop_is_believed(bench, program):
    bench.started(FAR_RAD, SLOW)
    bench.linuxcnc.kill(program)
    assert "dead task or realtime part" in wait_for_fault(bench)
    with pytest.raises(RobotStateUnknown, match="hardware stop"):
        bench.robot.stop()
    with pytest.raises(RobotStateUnknown):
        bench.robot.close()


def test_task_that_died_at_rest_is_noticed_by_the_next_order_and_when_coming_in(bench):
    bench.linuxcnc.kill("milltask")
    with pytest.raises(LinkDown, match="takes no orders"):
        bench.robot.move_joints(NEAR_RAD, 1.0)
    with pytest.raises(DeviceRefused, match="set"):
        bench.robot.reconnect()


def test_realtime_part_that_died_at_rest_is_noticed_by_a_move_without_motion(bench):
    bench.linuxcnc.kill("rtapi_app")
    bench.robot.move_joints(NEAR_RAD, 1.0)
    assert "dead task or realtime part" in wait_for_fault(bench)
    with pytest.raises(RobotStateUnknown):
        bench.robot.stop()
    with pytest.raises(RobotStateUnknown):
        bench.robot.close()


def test_server_that_dies_takes_the_wire_with_it(bench):
    bench.started(FAR_RAD, SLOW)
    bench.linuxcnc.kill("linuxcncrsh")
    with pytest.raises(DriverError):
        bench.arrived()
    with pytest.raises(RobotStateUnknown):
        bench.robot.stop()


def test_controller_started_anew_has_to_be_made_ready_anew(tmp_path):
    with joints_controller(tmp_path) as linuxcnc, at(linuxcnc) as bench:
        bench.started(FAR_RAD, SLOW)
        linuxcnc.restart()
        with pytest.raises(LinkDown):
            bench.robot.state()
        bench.robot.stop()
        bench.robot.reconnect()
        assert bench.robot.state().emergency_stop
        with pytest.raises(DeviceRefused):
            bench.robot.move_joints(NEAR_RAD, 1.0)
        bench.robot.prepare()
        assert bench.move(NEAR_RAD).fault == ""


def test_machine_of_five_joints_is_the_wrong_device(tmp_path):
    limits = "MIN_LIMIT = -46\nMAX_LIMIT = 91\nMAX_VELOCITY = 360\nMAX_ACCELERATION = 3600\n"
    edits = [
        ("JOINTS = 4", "JOINTS = 5"),
        ("XYZA", "XYZAB"),
        ("[AXIS_A]", f"[AXIS_B]\n{limits}\n[AXIS_A]"),
        ("[JOINT_3]", f"[JOINT_4]\nTYPE = ANGULAR\n{limits}\n[JOINT_3]"),
    ]
    with (
        joints_controller(tmp_path, edits=edits) as linuxcnc,
        pytest.raises(WrongDevice, match="5 rotary joints"),
    ):
        Bench(linuxcnc, Coordinates.JOINTS).robot.connect()


def test_other_kinematics_than_ours_is_the_wrong_device(tmp_path):
    edits = [
        ("KINEMATICS = pkmkins type=par4", "KINEMATICS = scarakins"),
        ("\nHALFILE = calib.hal", ""),
    ]
    with world_controller(tmp_path, edits=edits) as linuxcnc:
        bench = Bench(linuxcnc, Coordinates.WORLD)
        bench.robot.connect()
        try:
            with pytest.raises(DeviceRefused, match="without the pins of the expected kinematics"):
                bench.robot.prepare()
        finally:
            bench.robot.close()
