"""Stopping LinuxCNC, and leaving it: whatever has happened before, and loud when it is not seen."""

from math import radians

import pytest
from scripted_linuxcnc import NEVER, ready

from drivers.errors import LinkDown, RobotStateUnknown

TARGET_RAD = tuple(map(radians, (10.0, -20.0, 30.0, 40.0)))


def moving(**settings):
    linuxcnc = ready(**settings)
    linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    assert linuxcnc.is_moving()
    linuxcnc.asked.clear()
    return linuxcnc


def lose_the_wire(linuxcnc):
    """An answer fails to come, and the link closes itself."""
    linuxcnc.overrides["get joint_pos"] = NEVER
    with pytest.raises(LinkDown):
        linuxcnc.robot.state()
    del linuxcnc.overrides["get joint_pos"]
    linuxcnc.asked.clear()


def test_stop_aborts_and_returns_when_the_joints_stand():
    linuxcnc = moving()
    linuxcnc.robot.stop()
    assert linuxcnc.orders == ["set abort"]
    state = linuxcnc.robot.state()
    assert (state.moving, state.fault) == (False, "")
    assert state.joints != pytest.approx(TARGET_RAD)


def test_stop_opens_a_closed_wire_and_aborts_first():
    linuxcnc = moving()
    lose_the_wire(linuxcnc)
    linuxcnc.robot.stop()
    assert "set abort" in linuxcnc.orders
    assert not linuxcnc.is_moving()


def test_after_a_stop_over_a_new_wire_the_rest_waits_for_a_reconnection():
    linuxcnc = moving()
    lose_the_wire(linuxcnc)
    linuxcnc.robot.stop()
    with pytest.raises(LinkDown, match="not connected"):
        linuxcnc.robot.state()
    assert all(pipe.is_closed for pipe in linuxcnc.pipes)


def test_stop_takes_control_back_from_another_client():
    linuxcnc = moving()
    linuxcnc.in_control = "somebody"
    linuxcnc.robot.stop()
    assert linuxcnc.orders[0] == "set enable EMCTOO"
    assert not linuxcnc.is_moving()


def test_stop_works_although_the_operator_has_cancelled():
    wishes = []
    linuxcnc = moving(cancelled=lambda: bool(wishes))
    wishes.append("stop")
    linuxcnc.robot.stop()
    assert linuxcnc.orders == ["set abort"]


def test_machine_that_has_gone_off_only_has_to_be_seen_to_stand():
    linuxcnc = moving()
    linuxcnc.fail("joint 3 following error")
    linuxcnc.robot.stop()
    assert linuxcnc.orders == []


def test_abort_that_is_not_taken_is_followed_by_the_emergency_stop():
    linuxcnc = moving()
    linuxcnc.overrides["set abort"] = "SET ABORT NAK\n\r"
    linuxcnc.robot.stop()
    assert linuxcnc.orders == ["set abort", "set estop on"]
    assert not linuxcnc.machine


def test_acknowledged_abort_without_effect_is_no_stop():
    linuxcnc = moving()
    linuxcnc.overrides["set abort"] = "SET ABORT ACK\n\r"
    linuxcnc.overrides["get program_status"] = "PROGRAM_STATUS RUNNING\r\n"
    with pytest.raises(RobotStateUnknown, match=r"robot state unknown.*still moves"):
        linuxcnc.robot.stop()


def test_dead_task_behind_a_live_port_leaves_the_state_unknown():
    linuxcnc = moving()
    linuxcnc.task_lives = False
    with pytest.raises(RobotStateUnknown, match="neither abort nor e-stop") as unknown:
        linuxcnc.robot.stop()
    assert "hardware stop" in unknown.value.remedy


def test_nobody_there_leaves_the_state_unknown():
    linuxcnc = moving()
    lose_the_wire(linuxcnc)
    linuxcnc.connections = 0
    with pytest.raises(RobotStateUnknown, match="nobody answers"):
        linuxcnc.robot.stop()


def test_controller_that_was_started_anew_stands():
    linuxcnc = moving()
    lose_the_wire(linuxcnc)
    linuxcnc.fail("", estop=True)
    linuxcnc.homed, linuxcnc.mode = False, "MANUAL"
    linuxcnc.robot.stop()


def test_closing_stops_and_gives_control_back():
    linuxcnc = moving()
    linuxcnc.robot.close()
    assert linuxcnc.orders == ["set abort", "set mdi G94", "set enable off"]
    assert not linuxcnc.is_moving()
    assert linuxcnc.pipes[0].is_closed
    linuxcnc.robot.close()


def test_closing_leaves_another_clients_motion_alone():
    linuxcnc = moving()
    linuxcnc.in_control = "somebody"
    linuxcnc.robot.close()
    assert linuxcnc.orders == []
    assert linuxcnc.pipes[0].is_closed


def test_closing_in_motion_is_loud_when_the_stop_is_not_taken():
    linuxcnc = moving()
    linuxcnc.overrides["set abort"] = "SET ABORT NAK\n\r"
    with pytest.raises(RobotStateUnknown, match="could not be left standing"):
        linuxcnc.robot.close()
    assert linuxcnc.pipes[0].is_closed


def test_closing_at_rest_is_not_kept_up_by_a_dead_task():
    linuxcnc = moving()
    while linuxcnc.robot.state().moving:
        linuxcnc.clock.sleep_s(0.02)
    linuxcnc.task_lives = False
    linuxcnc.robot.close()
    assert linuxcnc.pipes[0].is_closed
