"""The robot from above: what is to be mended stands where it is, on robots of all mechanisms."""

import re
from dataclasses import replace

import pytest

from app.report.advice_sections import GREY, MEND, robot_from_above
from campaigns.evaluation.mechanical_advice import Instruction, MechanicalAdvice
from campaigns.mechanisms.catalog import MECHANISMS
from campaigns.robots.robot import find_robot

DELTA = find_robot("delta").robot


def to_mend(arm: int | None, **change: float) -> Instruction:
    by = {f"arm{arm}.{name}": value for name, value in change.items()}
    return Instruction(arm=arm, says="", act="", size=1.0, expanded=0.1, unit="mm", change=by)


def numbers(svg: str) -> list[tuple[str, float, float]]:
    found = re.findall(r'<text x="([\d.]+)" y="([\d.]+)" fill="#fff">(\d+)<', svg)
    return [(number, float(x), float(y)) for x, y, number in found]


def red_rods(svg: str) -> list[list[float]]:
    paths = re.findall(rf'<path d="([^"]+)" fill="none" stroke="{MEND}"', svg)
    return [[float(each) for each in re.findall(r"[\d.]+", path)] for path in paths]


@pytest.mark.parametrize("name", MECHANISMS)
def test_arms_to_mend_are_named_and_all_others_are_grey(name):
    robot = find_robot("par4-prototype" if name == "par4" else name).robot
    advice = MechanicalAdvice((to_mend(1, forearm_mm=0.2), to_mend(2, axis_tilt_deg=0.1)))
    svg, arms = robot_from_above(robot, advice), len(robot.mechanism.joints)
    assert 'to mend: arm 1, arm 2"' in svg
    assert [number for number, _, _ in numbers(svg)] == ["1", "2"]
    assert len(red_rods(svg)) == 2
    grey = re.findall(rf'<text [^>]*fill="{GREY}">(arm \d)<', svg)
    assert grey == [f"arm {arm}" for arm in range(arms) if arm not in {1, 2}]
    assert "nan" not in svg


@pytest.mark.parametrize(("skew", "above"), [(0.05, True), (-0.05, False)])
def test_a_rod_that_is_off_alone_is_red_on_its_side(skew, above):
    """Arm 0 of a Delta goes to the right: seen from the middle, its left is above."""
    change = to_mend(0, forearm_mm=0.1, parallelogram_skew_deg=skew)
    svg = robot_from_above(DELTA, MechanicalAdvice((change,)))
    ((_, start_y, _, end_y),), ((_, _, number_y),) = red_rods(svg), numbers(svg)
    middle = next(float(y) for y in re.findall(r'y="([\d.]+)" fill="[^"]*">arm 0<', svg))
    assert start_y == end_y
    assert (start_y < middle - 5.0) is above
    assert (number_y < middle) is above


def test_numbers_of_one_part_stand_beside_each_other():
    both = MechanicalAdvice((to_mend(1, joint_offset_deg=0.1), to_mend(1, axis_tilt_deg=0.1)))
    (_, x1, y1), (_, x2, y2) = numbers(robot_from_above(DELTA, both))
    assert 20.0 < ((x1 - x2) ** 2 + (y1 - y2) ** 2) ** 0.5 < 30.0


def test_a_centre_that_no_pose_can_take_is_not_drawn():
    robot = replace(DELTA, workspace_centre_mm=(0.0, 0.0, 500.0))
    advice = MechanicalAdvice((to_mend(1, forearm_mm=0.1),))
    assert "nan" not in robot_from_above(robot, advice)


def test_what_is_of_no_arm_stands_on_the_platform():
    svg = robot_from_above(DELTA, MechanicalAdvice((to_mend(None),)))
    ((_, x, _),) = numbers(svg)
    assert 'to mend: no arm"' in svg
    assert x < 210.0  # a Delta's arm 0 reaches further than the others: its platform is left
