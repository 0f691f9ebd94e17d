"""A robot on LinuxCNC: coming in, getting ready, its parameters."""

from math import radians

import pytest
from scripted_linuxcnc import TARGET_RAD, ScriptedLinuxcnc, arrive, connected, ready

from drivers import errors
from drivers.linuxcnc.settings import Coordinates
from drivers.values import Identity

IDENTITY = Identity("LinuxCNC", "Par4 in XYZA", "PAR4", "not told", "linuxcncrsh 1.1")


def test_connecting_moves_nothing_and_takes_control_with_bounded_orders():
    linuxcnc = connected()
    assert linuxcnc.asked[:2] == ["hello EMC pkmcal 1.1", "set echo off"]
    assert linuxcnc.orders[1:] == [
        "set verbose on",
        "set enable EMCTOO",
        "set timeout 2",
        "set set_wait received",
    ]
    assert linuxcnc.robot.identity() == IDENTITY
    linuxcnc = connected()
    assert (linuxcnc.estop, linuxcnc.machine, linuxcnc.homed) == (True, False, False)
    state = linuxcnc.robot.state()
    assert state.emergency_stop
    assert not state.moving


def test_newer_version_with_its_extra_lines_is_understood():
    linuxcnc = connected(newer=True)
    assert linuxcnc.orders[-1] == "set wait_mode received"
    linuxcnc.robot.prepare()
    linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    assert arrive(linuxcnc).joints == pytest.approx(TARGET_RAD, abs=radians(1e-6))


def test_connecting_stops_what_moves_before_anything_else(linuxcnc):
    linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    linuxcnc.pipes[0].close()  # the wire is lost, LinuxCNC goes on
    linuxcnc.asked.clear()
    linuxcnc.robot.reconnect()
    after_control = linuxcnc.orders[linuxcnc.orders.index("set set_wait received") + 1 :]
    assert after_control == ["set abort"]
    assert not linuxcnc.is_moving()
    state = linuxcnc.robot.state()
    assert (state.moving, state.fault) == (False, "")


@pytest.mark.parametrize(
    ("passwords", "word"), [(("other", "EMCTOO"), "connectpw"), (("EMC", "other"), "enablepw")]
)
def test_wrong_password_is_told_by_the_option_that_has_the_right_one(passwords, word):
    linuxcnc = ScriptedLinuxcnc()
    linuxcnc.passwords = passwords
    with pytest.raises(errors.WrongDevice, match="password") as error:
        linuxcnc.robot.connect()
    assert word in error.value.remedy
    assert linuxcnc.pipes[0].is_closed


@pytest.mark.parametrize("rotary", [3, 5])
def test_other_number_of_joints_is_the_wrong_device_and_is_left_alone(rotary):
    linuxcnc = ScriptedLinuxcnc()
    linuxcnc.types = ["ANGULAR"] * rotary + ["LINEAR"] * (6 - rotary)
    with pytest.raises(errors.WrongDevice, match=f"{rotary} rotary joints"):
        linuxcnc.robot.connect()
    assert linuxcnc.in_control is None
    assert "set abort" not in linuxcnc.orders


def test_another_machine_is_the_wrong_device():
    linuxcnc = ScriptedLinuxcnc()
    linuxcnc.units["USER_LINEAR_UNITS"] = "INCH"
    with pytest.raises(errors.WrongDevice, match="INCH, not in MM"):
        linuxcnc.robot.connect()
    linuxcnc = connected(Coordinates.WORLD)
    linuxcnc.overrides["get abs_act_pos"] = (
        "ABS_ACT_POS 0.100000 0.000000 0.000000 0.000000 0.000000 0.000000\r\n"
    )
    with pytest.raises(errors.WrongDevice, match=r"XYZC is 0\.1000") as error:
        linuxcnc.robot.prepare()
    assert "[KINS]KINEMATICS" in error.value.remedy


def test_preparing_takes_each_step_and_sees_it():
    linuxcnc = connected()
    linuxcnc.asked.clear()
    linuxcnc.robot.prepare()
    assert linuxcnc.orders == [
        "set estop off",
        "set machine on",
        "set mode manual",
        "set teleop_enable off",
        "set home -1",
        "set mode mdi",
    ]
    state = linuxcnc.robot.state()
    assert (state.fault, state.emergency_stop, state.moving) == ("", False, False)


def test_preparing_again_does_nothing(linuxcnc):
    linuxcnc.robot.prepare()
    assert linuxcnc.orders == []


def test_homing_or_an_emergency_stop_that_does_not_end_is_told():
    linuxcnc = connected()
    linuxcnc.chain_closed = False
    with pytest.raises(errors.EmergencyStop, match="stays on"):
        linuxcnc.robot.prepare()
    linuxcnc = connected()
    linuxcnc.overrides["get joint_homed"] = "JOINT_HOMED YES YES NO YES NO NO\r\n"
    with pytest.raises(errors.MotionFault, match="no homing within 120 s"):
        linuxcnc.robot.prepare()


def test_machine_that_goes_off_again_is_told_in_its_own_words():
    linuxcnc = connected()
    linuxcnc.drives_fine = False
    linuxcnc.overrides["get machine"] = ["MACHINE OFF\r\n", "MACHINE ON\r\n", "MACHINE OFF\r\n"]
    linuxcnc.overrides["get error"] = ["ERROR OK\r\n"] * 3 + [
        "ERROR joint 2 amplifier fault\r\n",
        "ERROR OK\r\n",
    ]
    with pytest.raises(errors.MotionFault, match="joint 2 amplifier fault"):
        linuxcnc.robot.prepare()


def test_geometry_is_replaced_at_rest_and_with_the_machine_off_where_it_works_inside():
    linuxcnc = ready(Coordinates.WORLD)
    linuxcnc.robot.write_geometry({"plate_mm": 101.0})
    assert linuxcnc.orders == ["set machine off"]
    assert not linuxcnc.machine
    assert linuxcnc.robot.read_geometry() == {"plate_mm": 101.0}
    linuxcnc = ready(Coordinates.WORLD)
    linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    with pytest.raises(errors.DeviceNotReady, match="moves"):
        linuxcnc.robot.write_geometry({"plate_mm": 101.0})
    assert linuxcnc.store.geometry == {"plate_mm": 100.0}
    assert linuxcnc.machine


def test_geometry_of_our_own_conversion_needs_no_power_cut(linuxcnc):
    linuxcnc.robot.write_geometry({"plate_mm": 101.0})
    assert linuxcnc.orders == []


def test_without_a_connection_no_geometry_is_replaced(linuxcnc):
    linuxcnc.robot.close()
    with pytest.raises(errors.LinkDown, match="not connected"):
        linuxcnc.robot.write_geometry({"plate_mm": 101.0})
    assert linuxcnc.store.geometry == {"plate_mm": 100.0}
