"""A robot that a person moves and a tracker whose points he types: what is asked and taken."""

from math import radians

import pytest
from robotline_layouts import FIVE_BAR_ON_A_RAIL, PAR4_LAYOUT, SIX_LEGS

from drivers.by_hand import (
    HandSettings,
    RobotByHand,
    TrackerByHand,
    recorded_joints,
    recorded_measurement,
)
from drivers.declaration import RobotSurroundings, Surroundings
from drivers.errors import AddressInvalid, DeviceRefused
from drivers.values import Pose

TARGET_DEG = (12.5, -7.25, 0.0, 89.99)
TARGET = tuple(map(radians, TARGET_DEG))


class Person:
    """Types its answers one after another, and keeps what it was asked."""

    def __init__(self, *answers):
        self.answers = [*answers]
        self.asked = []

    def __call__(self, question):
        self.asked.append(question)
        return self.answers.pop(0)


def robot(*answers, layout=PAR4_LAYOUT, target=TARGET):
    person = Person(*answers) if answers else None
    kept = {"plate_mm": 100.0}
    settings = HandSettings(
        serial="SN-1",
        in_place=(radians(0.02),) * len(target),
        read=lambda: dict(kept),
        write=kept.update,
        lacks=lambda names: (),
        joints_of=lambda held, pose: target,
    )
    made = RobotByHand(
        RobotSurroundings(
            layout=layout, prompt=person, settings=settings, open_transport=None, clock=None
        )
    )
    made.connect()
    return person, made


def tracker(prompt):
    return TrackerByHand(
        Surroundings(prompt=prompt, settings="4711", open_transport=None, clock=None)
    )


def test_enter_takes_the_joints_that_were_shown():
    person, moved = robot("")
    moved.move_joints(TARGET, 0.3)
    assert "q0 q1 q2 q3 = 12.5000 -7.2500 0.0000 89.9900 deg" in person.asked[0]
    state = moved.state()
    assert state.joints == pytest.approx(TARGET, abs=1e-12)
    assert (state.moving, state.fault, state.emergency_stop) == (False, "", False)
    assert recorded_joints(state.raw, PAR4_LAYOUT) == state.joints


def test_display_that_shows_another_place_is_asked_for_again_until_the_robot_is_there():
    person, moved = robot("12.5 -7.25 0.0 98.99", "12.5 -7.25 0.0", "12,51 -7,25 0,0 89,99")
    moved.move_joints(TARGET, 0.3)
    assert "joint q3 is 9.0000 from its target, limit 0.02" in person.asked[1]
    assert "3 numbers, 4 are needed" in person.asked[2]
    assert moved.state().joints[0] == pytest.approx(radians(12.51))


def test_joints_are_asked_for_once_where_nobody_has_moved_the_robot_yet():
    person, moved = robot("1 2 3 400", "1 2 3 4")
    assert moved.state().joints == pytest.approx(tuple(map(radians, (1, 2, 3, 4))))
    assert moved.state().raw == "1 2 3 4"
    assert len(person.asked) == 2
    assert "possible is -360 to 360°" in person.asked[1]


def test_pose_is_shown_with_its_coordinates_and_the_joints_to_expect():
    person, moved = robot("")
    moved.move_pose(Pose(120.0, -35.5, -575.0, radians(30.0)), 0.3)
    assert "x 120.000 mm y -35.500 mm z -575.000 mm theta 30.000 °" in person.asked[0]
    assert moved.state().joints == pytest.approx(TARGET)


def test_pose_in_a_plane_has_no_height_and_each_joint_its_unit():
    person, moved = robot("", layout=FIVE_BAR_ON_A_RAIL, target=(radians(10.0), 25.0))
    moved.move_pose(Pose(120.0, -35.5, 0.0), 0.3)
    assert "to the pose x 120.000 mm y -35.500 mm, by its" in person.asked[0]
    assert "q0 q1 = 10.0000 25.0000 deg mm" in person.asked[0]
    assert moved.state().joints == pytest.approx((radians(10.0), 25.0))


def test_pose_of_six_axes_is_shown_with_its_rotation_vector():
    person, moved = robot("", layout=SIX_LEGS, target=(10.0,) * 6)
    moved.move_pose(Pose(1.0, 2.0, 3.0, rotation_rad=(0.0, radians(-5.0), radians(20.0))), 0.3)
    assert "z 3.000 mm rx 0.000 ° ry -5.000 ° rz 20.000 °" in person.asked[0]


def test_parameters_count_as_loaded_once_somebody_says_so():
    person, moved = robot("n", "y")
    with pytest.raises(DeviceRefused, match="nobody has typed"):
        moved.write_geometry({"plate_mm": 100.04})
    assert moved.read_geometry() == {"plate_mm": 100.0}
    moved.write_geometry({"plate_mm": 100.04})
    assert "plate_mm                        100.040000" in person.asked[1]
    assert moved.read_geometry() == {"plate_mm": 100.04}


def test_nobody_there_is_refused_by_name_before_anything_moves():
    _, moved = robot()
    assert moved.state().joints == ()
    prepares = {"controller": moved.prepare, "tracker": lambda: tracker(None).prepare("CCR", 1.0)}
    for device, prepare in prepares.items():
        with pytest.raises(AddressInvalid, match=f"the {device} is worked by hand") as refused:
            prepare()
        assert f"{device}.driver" in refused.value.remedy


def test_point_is_taken_as_typed_and_read_again_from_the_record():
    measured = tracker(Person("X=2510,5 Y=-35,25 Z=75,0 mm ")).measure()
    assert measured.point_in_tracker_mm == (2510.5, -35.25, 75.0)
    assert (measured.covariance_mm2, measured.weather) == (None, None)
    assert measured.raw == "X=2510,5 Y=-35,25 Z=75,0 mm"
    assert recorded_measurement(measured.raw) == (measured.point_in_tracker_mm, None)


def test_line_that_is_no_point_is_asked_for_again_with_the_reason():
    person = Person("2510.5 -35.25", "9e9 0 0", "2510.5 -35.25 75.0")
    assert tracker(person).measure().point_in_tracker_mm == (2510.5, -35.25, 75.0)
    assert "2 numbers, 3 are needed" in person.asked[1]
    assert "possible is 0 to 200000 mm" in person.asked[2]


def test_point_before_pasted_again_is_asked_for_again_unless_it_is_given_twice():
    person = Person("1 2 3", "1 2 3", "1 2 4", "1 2 4", "1 2 4")
    device = tracker(person)
    points = [device.measure().point_in_tracker_mm for _ in range(3)]
    assert points == [(1, 2, 3), (1, 2, 4), (1, 2, 4)]
    assert sum("point before, to the last digit" in asked for asked in person.asked) == 2
