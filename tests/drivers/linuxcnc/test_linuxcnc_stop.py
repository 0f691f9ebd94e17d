"""Stopping LinuxCNC, and leaving it: whatever has happened before, and loud when it is not seen."""

from math import radians

import pytest
from scripted_linuxcnc import NEVER, arrive, connected, ready

from drivers.errors import Cancelled, LinkDown, RobotStateUnknown

TARGET_RAD = tuple(map(radians, (10.0, -20.0, 30.0, 40.0)))


def moving(**settings):
    linuxcnc = ready(**settings)
    linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    assert linuxcnc.is_moving()
    linuxcnc.asked.clear()
    return linuxcnc


@pytest.fixture
def linuxcnc():
    return moving()


def lose_the_wire(linuxcnc):
    """An answer fails to come, and the link closes itself."""
    linuxcnc.overrides["get joint_pos"] = NEVER
    with pytest.raises(LinkDown):
        linuxcnc.robot.state()
    del linuxcnc.overrides["get joint_pos"]
    linuxcnc.asked.clear()


def test_stop_aborts_and_returns_when_the_joints_stand(linuxcnc):
    linuxcnc.robot.stop()
    assert linuxcnc.orders == ["set abort"]
    state = linuxcnc.robot.state()
    assert (state.moving, state.fault) == (False, "")
    assert state.joints != pytest.approx(TARGET_RAD)


def test_stop_opens_a_closed_wire_and_aborts_first(linuxcnc):
    lose_the_wire(linuxcnc)
    linuxcnc.robot.stop()
    assert "set abort" in linuxcnc.orders
    assert not linuxcnc.is_moving()


def test_operator_is_alarmed_within_half_a_second_when_the_host_is_gone_and_connecting_hangs():
    alarms = []
    linuxcnc = moving(alarm=lambda _: alarms.append(linuxcnc.clock.now_s()))
    lose_the_wire(linuxcnc)
    linuxcnc.accepts_after_s = 1e6
    begun_s = linuxcnc.clock.now_s()
    with pytest.raises(RobotStateUnknown, match="within 8 s"):
        linuxcnc.robot.stop()
    (told_s,) = alarms
    assert told_s - begun_s == pytest.approx(0.5)
    assert linuxcnc.clock.now_s() - begun_s < 8.5


def wish_after(linuxcnc, seconds):
    """The wish to stop, from then on."""
    asked_s = linuxcnc.clock.now_s() + seconds
    return lambda: linuxcnc.clock.now_s() >= asked_s


@pytest.mark.parametrize("pending", ["get joint_pos", "get program_status", "get error"])
def test_pending_question_is_abandoned_and_the_abort_said_at_once_over_a_new_wire(pending):
    wishes = [lambda: False]
    linuxcnc = moving(cancelled=lambda: wishes[-1]())
    linuxcnc.overrides[pending] = NEVER
    wishes.append(wish_after(linuxcnc, 0.3))
    pressed_s = linuxcnc.clock.now_s() + 0.3
    with pytest.raises(Cancelled):
        arrive(linuxcnc)
    del linuxcnc.overrides[pending]
    linuxcnc.writes.clear()
    linuxcnc.robot.stop()
    sent_s, first = linuxcnc.writes[0]
    assert first == "hello EMC pkmcal 1.1\nset enable EMCTOO\nset abort\n"
    assert sent_s - pressed_s <= 0.03
    assert not linuxcnc.is_moving()


def test_nothing_is_waited_for_before_the_abort_over_a_new_wire(linuxcnc):
    lose_the_wire(linuxcnc)
    linuxcnc.overrides["hello EMC"] = NEVER
    begun_s = linuxcnc.clock.now_s()
    with pytest.raises(RobotStateUnknown):
        linuxcnc.robot.stop()
    assert linuxcnc.clock.now_s() - begun_s <= 8.0 + 0.1
    assert linuxcnc.asked[:3] == ["hello EMC pkmcal 1.1", "set enable EMCTOO", "set abort"]


def test_abort_that_is_refused_when_said_blindly_is_followed_by_the_emergency_stop(linuxcnc):
    lose_the_wire(linuxcnc)
    linuxcnc.overrides["set abort"] = "SET ABORT NAK\n\r"
    linuxcnc.robot.stop()
    assert linuxcnc.asked.count("set abort") == 2, "and that refusal was read"
    assert linuxcnc.orders[-2:] == ["set estop on", "set enable off"]
    assert not linuxcnc.machine


def test_emergency_stop_is_awaited_no_longer_than_the_stop_may_take(linuxcnc):
    linuxcnc.overrides["set abort"] = "SET ABORT NAK\n\r"
    linuxcnc.overrides["set estop"] = "SET ESTOP ACK\n\r"
    linuxcnc.overrides["get machine"] = "MACHINE ON\r\n"
    begun_s = linuxcnc.clock.now_s()
    with pytest.raises(RobotStateUnknown):
        linuxcnc.robot.stop()
    assert linuxcnc.clock.now_s() - begun_s <= 8.0 + 0.1


@pytest.mark.parametrize("wanted", [True, False])
def test_homing_that_is_not_waited_for_is_stopped_first(wanted):
    wishes = [lambda: False]
    linuxcnc = connected(cancelled=lambda: wishes[-1]())
    linuxcnc.overrides["set home"] = "SET HOME ACK\n\r"
    if wanted:
        wishes.append(wish_after(linuxcnc, 3.0))
    else:
        linuxcnc.overrides["get joint_homed"] = ["JOINT_HOMED NO NO NO NO\r\n"] * 9 + [NEVER]
    linuxcnc.asked.clear()
    with pytest.raises(Cancelled if wanted else LinkDown):
        linuxcnc.robot.prepare()
    orders = linuxcnc.orders
    assert "set abort" in orders[orders.index("set home -1") :]


def test_after_a_stop_over_a_new_wire_the_rest_waits_for_a_reconnection(linuxcnc):
    lose_the_wire(linuxcnc)
    linuxcnc.robot.stop()
    with pytest.raises(LinkDown, match="not connected"):
        linuxcnc.robot.state()
    assert all(pipe.is_closed for pipe in linuxcnc.pipes)


def test_stop_takes_control_back_from_another_client(linuxcnc):
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


def test_machine_that_has_gone_off_only_has_to_be_seen_to_stand(linuxcnc):
    linuxcnc.fail("joint 3 following error")
    linuxcnc.robot.stop()
    assert linuxcnc.orders == []


def test_abort_that_is_not_taken_is_followed_by_the_emergency_stop(linuxcnc):
    linuxcnc.overrides["set abort"] = "SET ABORT NAK\n\r"
    linuxcnc.robot.stop()
    assert linuxcnc.orders == ["set abort", "set estop on"]
    assert not linuxcnc.machine


def test_acknowledged_abort_without_effect_is_no_stop(linuxcnc):
    linuxcnc.overrides["set abort"] = "SET ABORT ACK\n\r"
    linuxcnc.overrides["get program_status"] = "PROGRAM_STATUS RUNNING\r\n"
    with pytest.raises(RobotStateUnknown, match=r"robot state unknown.*still moves"):
        linuxcnc.robot.stop()


def test_dead_task_behind_a_live_port_leaves_the_state_unknown(linuxcnc):
    linuxcnc.task_lives = False
    with pytest.raises(RobotStateUnknown, match="neither abort nor e-stop") as unknown:
        linuxcnc.robot.stop()
    assert "hardware stop" in unknown.value.remedy


def test_nobody_there_leaves_the_state_unknown(linuxcnc):
    lose_the_wire(linuxcnc)
    linuxcnc.connections = 0
    with pytest.raises(RobotStateUnknown, match="nobody answers"):
        linuxcnc.robot.stop()


def test_controller_that_was_started_anew_stands(linuxcnc):
    lose_the_wire(linuxcnc)
    linuxcnc.fail("", estop=True)
    linuxcnc.homed, linuxcnc.mode = False, "MANUAL"
    linuxcnc.robot.stop()


def test_closing_stops_and_gives_control_back(linuxcnc):
    linuxcnc.robot.close()
    assert linuxcnc.orders == ["set abort", "set mdi G94", "set enable off"]
    assert not linuxcnc.is_moving()
    assert linuxcnc.pipes[0].is_closed
    linuxcnc.robot.close()


def test_closing_leaves_another_clients_motion_alone(linuxcnc):
    linuxcnc.in_control = "somebody"
    linuxcnc.robot.close()
    assert linuxcnc.orders == []
    assert linuxcnc.pipes[0].is_closed


def test_closing_in_motion_is_loud_when_the_stop_is_not_taken(linuxcnc):
    linuxcnc.overrides["set abort"] = "SET ABORT NAK\n\r"
    with pytest.raises(RobotStateUnknown, match="could not be left standing"):
        linuxcnc.robot.close()
    assert linuxcnc.pipes[0].is_closed


def test_closing_at_rest_is_not_kept_up_by_a_dead_task(linuxcnc):
    while linuxcnc.robot.state().moving:
        linuxcnc.clock.sleep_s(0.02)
    linuxcnc.task_lives = False
    linuxcnc.robot.close()
    assert linuxcnc.pipes[0].is_closed


def test_silence_of_half_a_second_breaks_the_wire(linuxcnc):
    linuxcnc.overrides["get joint_pos"] = NEVER
    asked_s = linuxcnc.clock.now_s()
    with pytest.raises(LinkDown, match=r"within 0\.5 s"):
        linuxcnc.robot.state()
    assert linuxcnc.clock.now_s() - asked_s <= 0.5 + 0.02
