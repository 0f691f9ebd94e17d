"""A robot over robotline: units, refusals, faults of the wire."""

from math import pi, radians

import pytest
from robotline_layouts import FIVE_BAR_ON_A_RAIL, SIX_LEGS
from scripted_controller import ANSWER_S, ScriptedController, checked, connected

from drivers import errors
from drivers.values import Identity, Pose

IDENTITY = Identity("Example Robotics", "Par4", "SN-0042", "2.1", "robotline 1")


def test_identity_is_what_the_controller_says_after_an_empty_line_and_hello():
    controller = ScriptedController()
    controller.robot.connect()
    assert controller.pipes[0].sent == [b"\n", checked(">7 HELLO 1")]
    assert connected().robot.identity() == IDENTITY


def test_questions_are_numbered_on_over_reconnections():
    controller = ScriptedController()
    controller.robot.connect()
    controller.robot.state()
    controller.robot.reconnect()
    controller.robot.state()
    assert controller.numbers == [7, 8, 9, 10]


def test_state_comes_in_radians_with_motion_fault_and_emergency_stop(controller):
    state = controller.robot.state()
    assert state.joints == pytest.approx((0.0, -pi / 4, pi / 2, pi), abs=1e-15)
    assert (state.moving, state.emergency_stop, state.fault) == (False, False, "")
    assert checked("<8 STATE OK 0 0 - 0.0 -45.0 90.0 180.0") == state.raw.encode() + b"\n"
    controller.answers["STATE"] = "OK 1 1 drive%202 0.0 0.0 0.0 0.0"
    state = controller.robot.state()
    assert (state.moving, state.emergency_stop, state.fault) == (True, True, "drive 2")


def test_moves_are_sent_in_millimetres_degrees_and_per_cent(controller):
    controller.robot.move_joints([0.0, pi / 2, -pi / 4, pi], 0.25)
    controller.robot.move_pose(Pose(1.5, -2.5, -575.0, pi / 4), 1.0)
    assert controller.questions == [
        ">8 MOVEJ 0.0 90.0 -45.0 180.0 25.0",
        ">9 MOVEP 1.5 -2.5 -575.0 45.0 100.0",
    ]


@pytest.mark.parametrize("layout", [SIX_LEGS, FIVE_BAR_ON_A_RAIL])
def test_robot_with_other_poses_than_movep_has_moves_by_joints_alone(layout):
    count, turn = len(layout.joints), (0.0, 0.0, 0.1) if layout is SIX_LEGS else None
    controller = ScriptedController(layout)
    controller.answers["HELLO"] = f"OK 1 Example%20Robotics Hexapod SN-0042 2.1 {count}"
    controller.answers["STATE"] = f"OK 0 0 - {' '.join(['1.5'] * count)}"
    controller.robot.connect()
    controller.robot.move_joints([0.0] * count, 0.5)
    assert controller.questions[-1] == f">8 MOVEJ {'0.0 ' * count}50.0"
    assert len(controller.robot.state().joints) == count
    asked = len(controller.questions)
    with pytest.raises(errors.DeviceRefused, match="MOVEP of robotline 1 has no poses of") as no:
        controller.robot.move_pose(Pose(1.0, 2.0, 0.0, rotation_rad=turn), 1.0)
    assert "--program csv" in no.value.remedy
    assert len(controller.questions) == asked


@pytest.mark.parametrize(
    ("code", "error"),
    [
        ("LIMIT", errors.LimitViolation),
        ("REACH", errors.LimitViolation),
        ("FAULT", errors.MotionFault),
        ("ESTOP", errors.EmergencyStop),
        ("BUSY", errors.DeviceNotReady),
        ("GEOMETRY", errors.DeviceRefused),
        ("ARGUMENT", errors.DeviceRefused),
        ("VERB", errors.DeviceRefused),
        ("TIRED", errors.DeviceRefused),
    ],
)
def test_refusal_is_the_error_of_its_code_and_leaves_the_wire_open(controller, code, error):
    controller.answers["MOVEJ"] = f"NO {code} joint 2 to 95.0 deg"
    with pytest.raises(
        errors.DeviceRefused, match=f"MOVEJ refused, {code}: joint 2 to 95.0 deg"
    ) as no:
        controller.robot.move_joints([0.0] * 4, 0.5)
    assert type(no.value) is error
    assert no.value.code == code
    assert no.value.remedy
    assert controller.robot.state().moving is False


def test_question_that_was_damaged_on_its_way_closes_the_wire(controller):
    controller.pipes[0].respond = lambda _: [(ANSWER_S, checked("<8 ? NO CHECKSUM"))]
    with pytest.raises(errors.WireError, match="check the cable"):
        controller.robot.state()
    assert controller.pipes[0].is_closed


@pytest.mark.parametrize(
    "hello", ["NO VERSION 2 is spoken here", "OK 2 Ex Par4 1 1 4", "OK 1 Ex Par4 1 1 3"]
)
def test_other_version_or_other_robot_is_the_wrong_device(hello):
    controller = ScriptedController()
    controller.answers["HELLO"] = hello
    with pytest.raises(errors.WrongDevice):
        controller.robot.connect()
    assert controller.pipes[0].is_closed
    with pytest.raises(errors.LinkDown):
        controller.robot.state()


def test_late_answer_that_waits_in_the_line_is_never_believed(controller):
    controller.answers["STATE"] = None
    with pytest.raises(errors.LinkDown):
        controller.robot.state()
    controller.waiting = checked("<8 STATE OK 0 0 - 77.0 0.0 0.0 0.0")
    controller.answers["STATE"] = "OK 0 0 - 1.0 0.0 0.0 0.0"
    controller.robot.reconnect()
    assert controller.robot.state().joints[0] == radians(1.0)


def test_late_answer_that_comes_between_question_and_answer_is_never_believed(controller):
    stale = checked("<3 STATE OK 0 0 - 77.0 0.0 0.0 0.0")
    right = checked("<8 STATE OK 0 0 - 1.0 0.0 0.0 0.0")
    controller.pipes[0].respond = lambda _: [(ANSWER_S, stale), (2 * ANSWER_S, right)]
    assert controller.robot.state().joints[0] == radians(1.0)


@pytest.mark.parametrize(
    "answer",
    [
        checked("<8 STOP OK"),
        checked("<8 MOVEJ NO BUSY the robot moves"),
        checked("<8 STATE OK 0 0 - 1.0 0.0 0.0 0.0").replace(b"1.0", b"9.0"),
    ],
    ids=["other verb", "refusal of other verb", "damaged"],
)
def test_answer_that_is_none_closes_the_wire(controller, answer):
    controller.pipes[0].respond = lambda _: [(ANSWER_S, answer)]
    with pytest.raises(errors.WireError):
        controller.robot.state()
    assert controller.pipes[0].is_closed
