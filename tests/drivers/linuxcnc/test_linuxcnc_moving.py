"""Moves on LinuxCNC: what is sent, when they have ended, and everything that stops them."""

from math import degrees, nan, radians

import pytest
from scripted_linuxcnc import ORDER_S, TARGET_RAD, arrive, ready

from drivers import errors
from drivers.linuxcnc.settings import Coordinates
from drivers.values import Pose


def test_joint_move_is_a_rapid_in_degrees_with_six_decimals(linuxcnc):
    linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    assert linuxcnc.moves == ["G21 G90 G94 G53 G0 X10.000000 Y-20.000000 Z30.000000 A40.123457"]


def test_slower_move_is_given_the_time_that_its_longest_joint_needs(linuxcnc):
    linuxcnc.robot.move_joints(tuple(map(radians, (10.0, -20.0, 30.0, 40.0))), 0.25)
    assert linuxcnc.moves[0].startswith("G21 G90 G93 G53 G1 X10.000000")
    assert linuxcnc.moves[0].endswith("F37.500000")  # 40° at 25°/s: 1.6 s


def test_pose_is_converted_with_the_stored_set_where_only_joints_are_taken(linuxcnc):
    linuxcnc.robot.move_pose(Pose(100.0, -200.0, 300.0, radians(40.0)), 1.0)
    assert linuxcnc.moves[0].endswith("X10.000000 Y-20.000000 Z30.000000 A40.000000")


def test_pose_is_sent_as_it_is_and_joints_as_their_pose_where_the_kinematics_works():
    linuxcnc = ready(Coordinates.WORLD)
    linuxcnc.robot.move_pose(Pose(100.0, -200.0, 300.0, radians(40.0)), 1.0)
    assert linuxcnc.moves == ["G21 G90 G94 G53 G0 X100.000000 Y-200.000000 Z300.000000 C40.000000"]
    linuxcnc = ready(Coordinates.WORLD)
    linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    assert linuxcnc.moves[0].endswith("X100.000000 Y-200.000000 Z300.000000 C40.123457")
    assert arrive(linuxcnc).joints == pytest.approx(TARGET_RAD, abs=radians(1e-6))


def test_move_is_moving_from_the_order_to_the_last_reading_at_rest(linuxcnc):
    linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    assert linuxcnc.robot.state().moving
    state = arrive(linuxcnc)
    assert state.joints == pytest.approx(TARGET_RAD, abs=radians(1e-6))
    assert degrees(state.joints[3]) == pytest.approx(40.123457, abs=1e-9)


def test_idle_and_still_but_not_at_the_target_is_not_arrived(linuxcnc):
    linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    linuxcnc.frozen_at = linuxcnc.started_s  # a status from before the motion
    linuxcnc.overrides["get program_status"] = "PROGRAM_STATUS IDLE\r\n"
    assert linuxcnc.robot.state().moving


def test_joints_that_still_creep_have_not_arrived(linuxcnc):
    linuxcnc.overrides["get joint_pos"] = [
        f"JOINT_POS {0.01 * n:.6f} 0.000000 0.000000 0.000000\r\n" for n in range(9)
    ]
    assert linuxcnc.robot.state().moving


@pytest.mark.parametrize("angle_deg", [-45.1, 90.1, nan])
def test_target_outside_the_limits_is_never_sent(linuxcnc, angle_deg):
    with pytest.raises(errors.LimitViolation, match="joint 2"):
        linuxcnc.robot.move_joints((0.0, 0.0, radians(angle_deg), 0.0), 1.0)
    with pytest.raises(errors.LimitViolation):
        linuxcnc.robot.move_pose(Pose(0.0, 0.0, 10 * angle_deg, 0.0), 1.0)
    assert linuxcnc.asked == []


@pytest.mark.parametrize(
    ("messages", "error"),
    [
        (["Linear move on line 0 would exceed X's positive limit"], errors.LimitViolation),
        (["Linear move on line 0 fails kinematicsInverse"], errors.LimitViolation),
        (["joint 3 following error"], errors.MotionFault),
        (["Bad character 'u' used"], errors.DeviceRefused),
    ],
)
def test_refusal_that_comes_after_the_acknowledgement_is_raised(linuxcnc, messages, error):
    linuxcnc.refuses_move = messages
    with pytest.raises(errors.DeviceRefused, match=messages[0].split("'")[0]) as refused:
        linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    assert type(refused.value) is error
    linuxcnc.refuses_move = []
    linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    assert arrive(linuxcnc).fault == ""


def test_old_messages_are_no_reason_against_a_move(linuxcnc):
    linuxcnc.errors = ["joint 3 following error"]
    linuxcnc.robot.move_joints(TARGET_RAD, 1.0)


def test_stall_in_motion_is_a_fault_in_its_own_words(linuxcnc):
    linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    linuxcnc.fail("joint 3 following error")
    state = linuxcnc.robot.state()
    assert (state.fault, state.moving) == ("joint 3 following error", False)
    with pytest.raises(errors.MotionFault, match="machine is off"):
        linuxcnc.robot.move_joints(TARGET_RAD, 1.0)


def test_emergency_stop_in_motion_is_told_and_keeps_the_robot_from_moving(linuxcnc):
    linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    linuxcnc.fail("", estop=True)
    assert linuxcnc.robot.state().emergency_stop
    with pytest.raises(errors.EmergencyStop):
        linuxcnc.robot.move_joints(TARGET_RAD, 1.0)


def test_machine_made_ready_again_has_no_fault_any_more(linuxcnc):
    linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    linuxcnc.fail("joint 3 following error")
    assert linuxcnc.robot.state().fault
    linuxcnc.robot.prepare()
    assert linuxcnc.robot.state().fault == ""


def test_positions_that_freeze_in_motion_are_a_fault(linuxcnc):
    linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    linuxcnc.frozen_at = linuxcnc.clock.now_s()
    assert linuxcnc.robot.state().fault == ""
    linuxcnc.clock.sleep_s(1.6)
    state = linuxcnc.robot.state()
    assert "dead task" in state.fault
    assert state.moving


def test_move_that_is_taken_but_does_not_begin_is_a_fault(linuxcnc):
    linuxcnc.overrides["set mdi"] = ("SET MDI ACK\n\r", ORDER_S)
    with pytest.raises(errors.MotionFault, match="has not begun within 1 s"):
        linuxcnc.robot.move_joints(TARGET_RAD, 1.0)


def test_move_to_where_it_stands_has_begun_and_ended(linuxcnc):
    linuxcnc.robot.move_joints((0.0, 0.0, 0.0, 0.0), 1.0)
    assert not linuxcnc.robot.state().moving


def test_order_that_a_dead_task_does_not_take_closes_the_wire(linuxcnc):
    linuxcnc.task_lives = False
    with pytest.raises(errors.LinkDown, match="shows a machine that is on, but takes no orders"):
        linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    with pytest.raises(errors.LinkDown, match="not connected"):
        linuxcnc.robot.state()


def test_control_taken_by_another_client_is_a_fault_and_nothing_is_ordered(linuxcnc):
    linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    linuxcnc.in_control = "somebody"
    assert "another client" in linuxcnc.robot.state().fault
    linuxcnc.clock.sleep_s(1.0)
    orders = list(linuxcnc.orders)
    with pytest.raises(errors.DeviceNotReady, match="another client"):
        linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    assert linuxcnc.orders == orders


def test_controller_that_was_started_anew_is_not_homed(linuxcnc):
    linuxcnc.homed = False
    with pytest.raises(errors.DeviceNotReady, match="not homed"):
        linuxcnc.robot.move_joints(TARGET_RAD, 1.0)


def test_mode_that_somebody_changed_is_set_back_before_a_move(linuxcnc):
    linuxcnc.mode = "MANUAL"
    linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
    assert linuxcnc.orders[0] == "set mode mdi"


def test_word_that_is_refused_once_is_asked_again(linuxcnc):
    right = "MACHINE ON\r\n"
    linuxcnc.overrides["get machine"] = ["GET NAK\r\n", "GET MACHINE NAK\r\n", right]
    assert linuxcnc.robot.state().fault == ""
    linuxcnc.overrides["get machine"] = "GET MACHINE NAK\r\n"
    with pytest.raises(errors.DeviceRefused, match="refused 'get machine'"):
        linuxcnc.robot.state()


def test_answer_to_somebody_elses_question_closes_the_wire(linuxcnc):
    linuxcnc.overrides["get machine"] = "ESTOP OFF\r\n"
    with pytest.raises(errors.WireError, match="what nobody asked"):
        linuxcnc.robot.state()
    assert linuxcnc.pipes[0].is_closed


def test_acknowledgement_beside_a_complaint_is_none():
    linuxcnc = ready(newer=True)
    linuxcnc.overrides["set mdi"] = (
        "error: command 'SET MDI' timed out\r\nSET MDI ACK\r\n",
        ORDER_S,
    )
    with pytest.raises(errors.LinkDown, match="timed out"):
        linuxcnc.robot.move_joints(TARGET_RAD, 1.0)
