"""Firmware of printers: its values do what the projection promises, by equations of its manuals."""

import itertools
import re

import numpy as np
import pytest
from printers import printer
from scipy.optimize import fsolve

from campaigns.controllers.delta_firmware import (
    FIRMWARE,
    Bed,
    FirmwareDelta,
    Touches,
    firmware_text,
    project_firmware,
)
from campaigns.errors import IdentificationRefused
from campaigns.fit.rigid_transforms import fit_transform
from campaigns.kinematics.model import Kinematics
from campaigns.robots.robot import find_robot

SWITCH_MM = 600.0
"""Reading of the printer's carriages at their end stops."""
FAR_MM = 1000.0
DIGITS_MM = 2e-4
"""What is lost by the digits of the files."""
AS_BUILT = {
    "x": 0.7, "y": 0.7, "joint_offset": 1.0, "forearm": 0.3, "elevation": 5e-4, "rail_tilt": 5e-4,
}  # fmt: skip


@pytest.fixture(scope="module")
def poses():
    grid = itertools.product(np.linspace(-90.0, 90.0, 5), np.linspace(-90.0, 90.0, 5), (0, 60, 150))
    return np.array(list(grid), dtype=float)


def built(seed, deviations=AS_BUILT):
    """Printer with errors of every kind that an identification finds."""
    robot, rng = printer().kinematics, np.random.default_rng(seed)
    p = robot.p.copy()
    for stem, std in deviations.items():
        p[robot.mechanism.parameters.columns[stem]] += rng.normal(0.0, std, 3)
    return Kinematics(robot.mechanism, p)


def klipper_towers(text):
    values, section = {}, ""
    for line in text.splitlines():
        if line.startswith("["):
            section = line.strip("[]")
        elif not line.startswith("#"):
            key, value = line.split(": ")
            values[section, key] = value
    assert values["printer", "kinematics"] == "delta"
    radius = float(values["printer", "delta_radius"])
    arms, angles, stops = (
        np.array([float(values[f"stepper_{tower}", key]) for tower in "abc"])
        for key in ("arm_length", "angle", "position_endstop")
    )
    return radius, arms, angles, stops + np.sqrt(arms**2 - radius**2), [0, 1, 2]


def words(text, command):
    (line,) = (line for line in text.splitlines() if line.startswith(command))
    return {word[0]: word[1:] for word in line.split()[1:]}


def numbers(words, letters):
    return np.array([float(words[letter]) for letter in letters])


def towers_named(text):
    return [
        int(arm) for arm in re.search(r"X is arm(\d), Y is arm(\d), Z is arm(\d)", text).groups()
    ]


def marlin_towers(text):
    sizes, stops = words(text, "M665"), words(text, "M666")
    radius, arms = float(sizes["R"]), float(sizes["L"]) + numbers(sizes, "ABC")
    down = -numbers(stops, "XYZ")
    assert (down >= 0.0).all()  # carriages cannot go up from their end stops
    tops = float(sizes["H"]) + np.sqrt(arms**2 - radius**2) + down
    return (
        radius,
        arms,
        np.add(numbers(sizes, "XYZ"), [210.0, 330.0, 90.0]),
        tops,
        towers_named(text),
    )


def reprap_towers(text):
    sizes, stops = words(text, "M665"), words(text, "M666")
    radius, arms = float(sizes["R"]), np.array([float(rod) for rod in sizes["L"].split(":")])
    tops = float(sizes["H"]) + np.sqrt(arms**2 - radius**2) + numbers(stops, "XYZ")
    assert (stops["A"], stops["B"]) == ("0", "0")
    return (
        radius,
        arms,
        np.add(numbers(sizes, "XYZ"), [210.0, 330.0, 90.0]),
        tops,
        towers_named(text),
    )


TOWERS = {"klipper": klipper_towers, "marlin": marlin_towers, "reprap": reprap_towers}


def _gaps(point, centres, arms):
    return np.linalg.norm(centres - point, axis=1) - arms


def positions(firmware, text, joints, near):
    """Positions that a firmware believes in, with its carriages so far from their end stops."""
    radius, arms, angles, tops, order = TOWERS[firmware](text)
    outward = np.column_stack([np.cos(np.radians(angles)), np.sin(np.radians(angles))])
    points = []
    for readings, place in zip(joints[:, order], near, strict=True):
        centres = np.column_stack([radius * outward, tops + readings - SWITCH_MM])
        centres = centres + FAR_MM  # a solver stops by the size of its unknowns
        apart = fsolve(_gaps, place + FAR_MM + 0.5, args=(centres, arms), xtol=1e-11)
        points.append(apart - FAR_MM)
    return np.array(points)


@pytest.mark.parametrize("firmware", FIRMWARE)
def test_the_firmware_is_where_the_projected_robot_is(firmware, poses):
    made = project_firmware(built(1), poses, SWITCH_MM)
    joints = made.kinematics.inverse(poses).values_or_raise()
    text = firmware_text(firmware, made.values, ["made of an identification"])
    assert text.splitlines()[0][2:] == "made of an identification"
    np.testing.assert_allclose(
        positions(firmware, text, joints, poses), poses, atol=DIGITS_MM, rtol=0.0
    )


def test_values_of_a_printer_without_other_errors_are_its_own(poses):
    """Towers on one circle are the only condition."""
    identified = built(2, {"joint_offset": 1.0, "forearm": 0.3})
    made = project_firmware(identified, poses, SWITCH_MM)
    assert made.errors_mm.max() < 1e-9
    columns = identified.mechanism.parameters.columns
    np.testing.assert_allclose(made.values.arms_mm, identified.p[columns["forearm"]], atol=1e-8)
    tops = identified.p[columns["joint_offset"]] + SWITCH_MM
    stops = tops - np.sqrt(identified.p[columns["forearm"]] ** 2 - made.values.radius_mm**2)
    np.testing.assert_allclose(made.values.endstops_mm, stops, atol=1e-7)
    np.testing.assert_allclose(made.values.angles_deg, [210.0, 330.0, 90.0], atol=1e-7)


def test_no_other_values_leave_less(poses):
    identified = built(3)
    made = project_firmware(identified, poses, SWITCH_MM)
    joints = identified.inverse(poses).values_or_raise()
    columns = identified.mechanism.parameters.columns

    def rms(p):
        reached = Kinematics(identified.mechanism, p).forward(joints, poses).values_or_raise()
        errors = fit_transform(reached, poses).apply(reached) - poses
        return np.sqrt((errors**2).sum(axis=1).mean())

    least = rms(made.kinematics.p)
    assert least == pytest.approx(np.sqrt((made.errors_mm**2).mean()), rel=1e-6)
    assert 1e-3 < least < 0.2 * rms(printer().kinematics.p)
    for stem in ("forearm", "joint_offset"):
        for place in columns[stem]:
            for step in (-0.01, 0.01):
                p = made.kinematics.p.copy()
                p[place] += step
                assert rms(p) > least


def test_heights_above_a_bed_that_leans_are_right_and_rods_stay(poses):
    """Values by the base frame leave the bed's lean, those by its touches do not."""
    identified, slopes = built(4), np.array([2e-3, -1e-3])
    joints = identified.inverse(poses).values_or_raise()
    heights = poses[:, 2] - 0.4 - poses[:, :2] @ slopes
    places = poses[poses[:, 2] == 0.0]
    bed = np.column_stack([places[:, :2], 0.4 + places[:, :2] @ slopes])
    touches = Touches(identified.inverse(bed).values_or_raise(), np.zeros(len(bed)))
    off = {}
    for name, of in {"base": None, "bed": touches}.items():
        made = project_firmware(identified, poses, SWITCH_MM, of)
        believed = made.kinematics.forward(joints, poses).values_or_raise()
        off[name] = np.abs(believed[:, 2] - heights).max()
        assert (made.bed is None) == (of is None)
    assert off["base"] > 0.25
    assert off["bed"] < 0.1
    on_bed = made.kinematics.forward(touches.joints, bed).values_or_raise()
    level = Bed.of(on_bed, np.zeros(len(on_bed)))
    assert level.tilt_mrad < 0.05
    assert abs(on_bed[:, 2].mean()) < 1e-9
    assert made.bed.tilt_mrad == pytest.approx(np.hypot(2.0, 1.0), rel=1e-4)
    rods = identified.p[identified.mechanism.parameters.columns["forearm"]]
    np.testing.assert_allclose(made.values.arms_mm, rods)
    # what upright towers cannot do stays in the stated errors: prints are sheared by the lean
    assert made.errors_mm.max() > 0.1


def test_a_bed_is_found_under_its_touches_beside_a_wrong_one():
    rng = np.random.default_rng(5)
    points = np.column_stack([rng.uniform(-90.0, 90.0, (30, 2)), np.zeros(30)])
    heights = rng.uniform(0.0, 0.2, 30)
    points[:, 2] = 0.3 + points[:, :2] @ [1e-3, -2e-3] + heights
    points[7, 2] += 3.0
    bed = Bed.of(points, heights)
    assert bed.slopes == pytest.approx((1e-3, -2e-3), abs=2e-5)
    assert bed.height_mm == pytest.approx(0.3, abs=2e-3)
    seen = bed.from_base.apply(points)
    assert np.delete(seen[:, 2] - heights, 7) == pytest.approx(0.0, abs=3e-3)
    np.testing.assert_allclose(
        bed.from_base.rotation @ bed.from_base.rotation.T, np.eye(3), atol=1e-12
    )


def test_towers_are_named_by_their_directions():
    values = FirmwareDelta(
        100.0, (250.0, 251.0, 252.0), (89.0, 211.0, 331.5), (300.0, 301.0, 302.0)
    )
    text = firmware_text("reprap", values, [])
    assert "X is arm1, Y is arm2, Z is arm0" in text
    sizes = words(text, "M665")
    assert numbers(sizes, "XYZ").tolist() == [1.0, 1.5, -1.0]
    assert sizes["L"] == "251.0000:252.0000:250.0000"


def test_other_mechanisms_are_refused_with_what_to_do(poses):
    robot = find_robot("delta").robot
    with pytest.raises(IdentificationRefused, match="computes no delta") as raised:
        project_firmware(robot.kinematics, poses, 0.0)
    assert "--format plain" in raised.value.remedy


def test_a_workspace_out_of_reach_is_refused(poses):
    with pytest.raises(IdentificationRefused, match="can take 0 of 75 poses"):
        project_firmware(built(6), poses + np.array([1000.0, 0.0, 0.0]), SWITCH_MM)
