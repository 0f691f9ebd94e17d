"""A printer's configuration is read: its sizes, and what its firmware measured."""

import math

import numpy as np
import pytest

from campaigns.errors import ConfigInvalid
from campaigns.robots.printer_config import PrinterConfig
from campaigns.robots.robot import find_robot

FILE = """\
[mcu]
serial: /dev/ttyUSB0
[stepper_a]
step_pin: PE3
position_endstop = 300.5 ; measured
arm_length: 290.0 # by a calliper
rotation_distance: 40
microsteps: 16
[stepper_b]
angle: 329.5
position_endstop: 301.0
[stepper_c]
arm_length: 290.4
rotation_distance: 40
microsteps: 16
gear_ratio: 80:16, 3:1
full_steps_per_rotation: 400
[printer]
kinematics: delta
delta_radius: 130.0
[gcode_macro G29]
gcode:
    {% if printer %}
    [no_section]
    G28
    {% endif %}
[delta_calibrate]
radius: 80
height0 = 9.9

#*# <---------------------- SAVE_CONFIG ---------------------->
#*# DO NOT EDIT THIS BLOCK OR BELOW. The contents are auto-generated.
#*#
#*# [printer]
#*# delta_radius = 131.0
#*#
#*# [delta_calibrate]
#*# height0 = 0.25
#*# height0_pos = 1000.000,2000.000,3000.000
#*# height10 = 0.0
#*# height10_pos = 4,5,6
#*# height2 = 0.5
#*# height2_pos = 1,2,3
#*# manual_height0 = -0.1
#*# manual_height0_pos = 7,8,9
#*# distance0 = 64.9
#*# distance0_pos1 = 10,20,30
#*# distance0_pos2 = 40,50,60
"""


def read(text=FILE):
    return PrinterConfig.of_text(text, "folder/printer.cfg")


def test_what_was_saved_takes_the_place_of_what_people_wrote():
    printer = read()
    assert (printer.name, printer.radius_mm, printer.bed_mm) == ("printer", 131.0, 80.0)
    a, b, c = printer.towers
    assert (a.angle_deg, b.angle_deg, c.angle_deg) == (210.0, 329.5, 90.0)
    assert (a.arm_mm, b.arm_mm, c.arm_mm) == (290.0, 290.0, 290.4)
    assert (a.endstop_mm, b.endstop_mm, c.endstop_mm) == (300.5, 301.0, 300.5)
    assert a.mm_per_step == b.mm_per_step == 40.0 / (200.0 * 16.0)
    assert c.mm_per_step == pytest.approx(40.0 / (400.0 * 16.0 * 15.0))


def test_heights_and_distances_come_in_the_order_of_their_numbers():
    saved = read().saved
    named = [(value.kind, value.number) for value in saved]
    heights = [("height", 0), ("height", 2), ("height", 10)]
    assert named == [*heights, ("manual_height", 0), ("distance", 0)]
    assert saved[0].value_mm == 0.25
    assert saved[0].joints_mm[0][:2] == (-12.5, -25.0)
    assert len(saved[-1].joints_mm) == 2
    assert saved[-1].value_mm == 64.9
    lines = FILE.splitlines()
    assert [lines[value.line - 1] for value in saved[:2]] == [
        "#*# height0 = 0.25", "#*# height2 = 0.5",
    ]  # fmt: skip


def test_a_carriage_so_many_steps_below_its_end_stop_has_the_nozzle_where_the_firmware_has_it(
    tmp_path,
):
    path = tmp_path / "printer.cfg"
    path.write_text(FILE, encoding="utf-8")
    robot = find_robot(str(path)).robot
    nozzle = np.array([20.0, -30.0, 5.0])
    angles, rods = np.radians([210.0, 329.5, 90.0]), np.array([290.0, 290.0, 290.4])
    tops = np.array([300.5, 301.0, 300.5]) + np.sqrt(rods**2 - 131.0**2)
    towers = 131.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    out = ((towers - nozzle[:2]) ** 2).sum(axis=1)
    readings = nozzle[2] + np.sqrt(rods**2 - out) - tops
    reached = robot.kinematics.forward(readings[None]).values_or_raise()[0]
    np.testing.assert_allclose(reached, nozzle, atol=1e-8)
    assert robot.limits.joint[1] == 0.0
    assert robot.mechanism.name == "linear-delta"
    # the bed's edge, opposite a tower, is within limits of joints and swing
    for angle in angles + math.pi:
        edge = np.array([[80.0 * np.cos(angle), 80.0 * np.sin(angle), 0.0]])
        assert robot.kinematics.feasibility(robot.limits, edge).feasible.all()


def test_a_file_of_old_with_the_distance_of_a_step_is_read():
    old = FILE.replace("rotation_distance: 40\nmicrosteps: 16", "step_distance: .0125")
    assert [tower.mm_per_step for tower in read(old).towers] == [0.0125] * 3


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("kinematics: delta", "kinematics: corexy", "kinematics is corexy, must be delta"),
        ("kinematics: delta", "", r"\[printer\] kinematics is missing"),
        ("#*# delta_radius = 131.0", "#*# delta_radius = wide", "delta_radius is 'wide'"),
        ("#*# delta_radius = 131.0", "#*# delta_radius = -1", "delta_radius is -1, must be above"),
        ("#*# delta_radius = 131.0", "#*# delta_radius = 1e308", "is 1e\\+308, must be .* at most"),
        ("#*# delta_radius = 131.0", "#*# delta_radius = 295", "must be above delta"),
        ("position_endstop = 300.5", "position_endstop = nan", "position_endstop is 'nan'"),
        ("rotation_distance: 40", "", r"\[stepper_a\] rotation_distance is missing"),
        ("microsteps: 16", "", r"\[stepper_a\] microsteps is missing"),
        ("80:16", "80:0", "gear_ratio has '80:0'"),
        ("4,5,6", "4,5", "height10_pos holds 2 numbers"),
        ("#*# height2_pos = 1,2,3\n", "", "height2_pos is missing"),
        ("[mcu]", "serial", "no configuration of Klipper"),
        ("serial: /dev/ttyUSB0", "serial\n  and more", "no configuration of Klipper"),
    ],
)  # fmt: skip
def test_a_file_that_says_something_else_is_refused_with_its_key(old, new, says):
    assert old in FILE
    with pytest.raises(ConfigInvalid, match=says) as raised:
        read(FILE.replace(old, new))
    assert "folder/printer.cfg" in str(raised.value)
    assert raised.value.remedy


def test_a_section_in_another_file_is_asked_for():
    with pytest.raises(ConfigInvalid) as raised:
        read(FILE.replace("rotation_distance: 40", "") + "[include steppers.cfg]\n")
    assert "[include …]" in raised.value.remedy
