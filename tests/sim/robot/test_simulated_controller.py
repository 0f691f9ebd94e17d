"""The controller: moves in time, refuses with a reason, stops at once, faults by script."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from sim.faults import Counted, Fault, FaultScript
from sim.random_streams import WorkedTime
from sim.robot.controller import ControllerKinematics, Refusal, SimulatedController
from sim.robot.section import ControllerSection, nominal_robot

HOME = np.radians([30.0, 30.0, 20.0, 20.0])
THERE = tuple(np.radians([40.0, 35.0, 10.0, 20.0]))


class Axes:
    """Follows everything, or only a part of any way; remembers where it came to rest."""

    standing = SimpleNamespace(encoders=HOME)

    def __init__(self, part=1.0):
        self.part = part
        self.rests = []

    def passable_part(self, encoders):
        return self.part

    def arrive(self, encoders, target):
        self.rests.append((encoders, target))


def controller(*, faults=(), axes=None, worked=None, **settings):
    return SimulatedController(
        ControllerSection(serial="SIM-C-7", **settings),
        axes or Axes(),
        geometry=nominal_robot("par4-prototype")[1],
        faults=FaultScript(faults, {}),
        worked=worked or WorkedTime(0.0),
    )


def refusal(call, *arguments):
    with pytest.raises(Refusal) as refused:
        call(*arguments)
    return refused.value


def test_a_move_takes_its_time_and_ends_exactly_in_place():
    axes, worked = Axes(), WorkedTime(0.0)
    robot = controller(axes=axes, worked=worked)
    takes_s = robot.move_joints(THERE, 1.0, 5.0)
    assert robot.state(5.0 + 0.99 * takes_s).moving
    state = robot.state(5.0 + takes_s)
    assert not state.moving
    assert state.joints == pytest.approx(THERE, abs=math.radians(0.5e-6))
    assert axes.rests[0][1] == (40_000_000, 35_000_000, 10_000_000, 20_000_000)
    assert worked.seconds == takes_s


def test_no_joint_exceeds_its_speed_and_all_arrive_together():
    robot = controller()
    takes_s = robot.move_joints(THERE, 0.5, 0.0)
    times = np.linspace(0.0, takes_s, 400)
    path = np.array([robot.state(now_s).joints for now_s in times])
    speeds = np.abs(np.diff(path, axis=0)).max() / (times[1] - times[0])
    assert 0.98 * math.radians(90.0) < speeds <= 1.001 * math.radians(90.0)
    parts = (path[1:-1] - HOME)[:, :3] / (np.array(THERE) - HOME)[:3]
    assert np.ptp(parts, axis=1).max() < 1e-6


HOME_DEG = (30.0, 20.0, 20.0)


@pytest.mark.parametrize(
    ("joints_deg", "speed"),
    [
        *(((joint_deg, *HOME_DEG), 1.0) for joint_deg in (-45.1, 90.1, math.nan, math.inf)),
        *((np.degrees(THERE), speed) for speed in (0.0, -0.1, 1.01, math.nan)),
        (HOME_DEG, 1.0),
    ],
)
def test_joints_outside_their_limits_impossible_speeds_and_three_joints_are_refused(
    joints_deg, speed
):
    refused = refusal(controller().move_joints, np.radians(joints_deg), speed, 0.0)
    assert refused.code == "LIMIT"
    assert "joint 0" in refused.text or (speed, len(joints_deg)) != (1.0, 4)


def test_a_moving_robot_takes_neither_moves_nor_parameters():
    robot = controller()
    robot.move_joints(THERE, 1.0, 0.0)
    assert refusal(robot.move_joints, tuple(HOME), 1.0, 0.01).code == "BUSY"
    assert refusal(robot.replace_geometry, robot.geometry(), 0.01).code == "BUSY"


def test_stop_brakes_within_a_moment_and_on_the_way():
    robot, axes = controller(), Axes()
    robot = controller(axes=axes)
    takes_s = robot.move_joints(THERE, 0.2, 0.0)
    before = robot.state(takes_s / 2).joints
    robot.stop(takes_s / 2)
    state = robot.state(takes_s / 2 + 0.051)
    assert not state.moving
    travelled = (np.array(state.joints) - before)[:3] / (np.array(THERE) - HOME)[:3]
    assert 0.0 < travelled.min() < 0.2
    assert np.ptp(travelled) < 1e-6
    assert len(axes.rests) == 1
    assert robot.move_joints(THERE, 1.0, takes_s) > 0.0


def test_parameters_are_replaced_all_or_none():
    robot = controller()
    before = robot.geometry()
    incomplete = {name: 1.0 for name in before if name != "arm2.y_mm"}
    assert refusal(robot.replace_geometry, incomplete, 0.0).code == "GEOMETRY"
    assert refusal(robot.replace_geometry, before | {"arm1.arm_mm": -1.0}, 0.0).code == "GEOMETRY"
    assert refusal(robot.replace_geometry, before | {"plate_mm": math.nan}, 0.0).code == "GEOMETRY"
    assert refusal(robot.replace_geometry, before | {"arm9.x_mm": 1.0}, 0.0).code == "GEOMETRY"
    assert robot.geometry() == before
    robot.replace_geometry(before | {"arm1.arm_mm": 351.0}, 0.0)
    assert robot.geometry()["arm1.arm_mm"] == 351.0


def test_a_pressed_emergency_stop_refuses_every_move():
    robot = controller(emergency_stop=True)
    assert robot.state(0.0).emergency_stop
    assert refusal(robot.move_joints, THERE, 1.0, 0.0).code == "ESTOP"


def test_a_drive_fault_halts_the_second_move_halfway_and_clears_in_time():
    robot = controller(faults=[Fault(Counted.MOVE, 2, "drive_fault", 5.0)])
    takes_s = robot.move_joints(tuple(HOME), 1.0, 0.0)
    now_s = takes_s + robot.move_joints(THERE, 1.0, takes_s)
    state = robot.state(now_s)
    assert state.fault
    assert not state.moving
    assert state.joints == pytest.approx((HOME + THERE) / 2, abs=1e-7)
    assert refusal(robot.move_joints, THERE, 1.0, now_s).code == "FAULT"
    assert robot.state(now_s + 5.0).fault == ""


def test_a_stalled_robot_claims_to_move_until_it_is_stopped():
    robot = controller(faults=[Fault(Counted.MOVE, 1, "stall", None)])
    takes_s = robot.move_joints(THERE, 1.0, 0.0)
    halfway = robot.state(takes_s).joints
    assert robot.state(1e6).moving
    assert robot.state(1e6).joints == halfway
    robot.stop(1e6)
    assert not robot.state(1e6).moving


def test_a_mechanism_that_cannot_follow_trips_the_drives_where_it_holds():
    robot = controller(axes=Axes(part=0.25))
    takes_s = robot.move_joints(THERE, 1.0, 0.0)
    state = robot.state(takes_s)
    assert "following error" in state.fault
    assert state.joints == pytest.approx(HOME + 0.25 * (THERE - HOME), abs=1e-7)
    assert robot.state(takes_s + 10.0).fault == ""


def test_ripples_come_as_often_as_the_loaded_set_says():
    def commanded(**told):
        robot = SimulatedController(
            ControllerSection(),
            Axes(),
            geometry=nominal_robot("par4-prototype")[1] | {"arm1.ripple_sin_deg": 0.1} | told,
            faults=FaultScript((), {}),
            worked=WorkedTime(0.0),
            kinematics=ControllerKinematics(ripple_rate=30.0),
        )
        assert "ripples_per_turn" in robot.extensions
        return robot.state(robot.move_pose(20.0, 30.0, -550.0, 0.0, 1.0, 0.0)).joints

    known, same, other = (
        commanded(),
        commanded(ripples_per_turn=30.0),
        commanded(ripples_per_turn=7),
    )
    assert known == same
    assert abs(known[1] - other[1]) > 1e-4
