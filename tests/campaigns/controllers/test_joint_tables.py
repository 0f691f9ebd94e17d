"""Joint tables: what axes add to joints, from either side, within a tolerance."""

import numpy as np
import pytest

from campaigns.controllers.joint_tables import FORMATS, LINUXCNC_POINTS, joint_tables
from campaigns.controllers.model_reduction import left_as_commanded
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.transmission import approach_along
from campaigns.robots.robot import find_robot

ROBOT = find_robot("par4-prototype").robot
LIMITS = ROBOT.limits.joint
GEARS = {
    f"arm{arm}.{name}": value * (1.0 + 0.1 * arm)
    for arm in range(4)
    for name, value in {
        "encoder_gain_ppm": 100.0,
        "eccentricity_sin_deg": 0.011,
        "eccentricity_cos_deg": -0.004,
        "ripple_sin_deg": 0.005,
        "ripple_cos_deg": 0.002,
        "backlash_deg": 0.005,
    }.items()
}
MODEL = Kinematics.of(ROBOT.mechanism.with_ripples(30.0), ROBOT.parameters | GEARS)
CRANK_MM = 350.0


def drawn(count=300):
    draw = np.random.default_rng(4)
    return draw.uniform(*LIMITS, (count, 4)), draw.choice((-1.0, 1.0), (count, 4))


@pytest.mark.parametrize("tolerance_mm", [0.01, 0.001])
def test_joints_that_tables_correct_stand_where_they_are_wanted_from_both_sides(tolerance_mm):
    wanted, sides = drawn()
    tables = joint_tables(MODEL, LIMITS, tolerance_mm)
    there = MODEL.mechanism.true_joints(MODEL.p, tables.readings(wanted, sides), sides)
    off_mm = CRANK_MM * np.abs(there - wanted).max()
    assert off_mm < 1.05 * tolerance_mm
    assert off_mm < 1.05 * tables.left_mm
    assert (
        CRANK_MM * np.abs(tables.readings(wanted, -sides) - tables.readings(wanted, sides)).min()
        > 0.03
    )


def test_tables_of_few_points_say_what_they_leave():
    fine, few = joint_tables(MODEL, LIMITS, 1e-4), joint_tables(MODEL, LIMITS, 1e-4, 40)
    assert (len(few.wanted), fine.left_mm <= 1e-4) == (40, True)
    assert few.left_mm > 10 * fine.left_mm
    assert len(joint_tables(MODEL, LIMITS, 1e-2).wanted) < len(fine.wanted)


def test_linuxcnc_gets_no_more_points_than_it_takes_and_no_heading():
    files_of, most = FORMATS["linuxcnc"]
    tables = joint_tables(MODEL, LIMITS, 1e-6, most)
    lines = files_of(tables)["joint2.comp"].splitlines()
    rows = np.array([list(map(float, line.split())) for line in lines[:-1]])
    assert (len(rows), lines[-1][0]) == (LINUXCNC_POINTS, "#")
    assert (np.diff(rows[:, 0]) > 0.0).all()
    np.testing.assert_allclose(np.radians(rows[:, 1:]).T, tables.corrections[:, :, 2], atol=1e-11)


def test_other_forms_hold_the_same_numbers():
    tables = joint_tables(MODEL, LIMITS, 0.01)
    text = FORMATS["csv"][0](tables)["joint-tables.csv"]
    head, first, *_ = text.splitlines()
    falling = float(first.split(",")[head.split(",").index("q3_falling_deg")])
    assert np.radians(falling) == pytest.approx(tables.corrections[1, 0, 3], abs=1e-11)
    structured = FORMATS["twincat"][0](tables)["joint-tables.st"]
    assert f"Compensation := {falling:.9f})" in structured.split("q3_falling : ")[1]
    assert structured.count("Direction := WorkDirectionNegative") == 4
    assert structured.count("(Position := ") == 8 * len(tables.wanted)


def test_what_is_left_of_a_robot_with_and_without_tables():
    space = MODEL.mechanism.parameters
    rest = Kinematics(MODEL.mechanism, MODEL.p[: len(space.geometry)])
    draw = np.random.default_rng(6)
    poses = draw.uniform([-150, -150, -650, -0.4], [150, 150, -500, 0.4], (200, 4))
    sides = draw.choice((-1.0, 1.0), (200, 4))
    tables = joint_tables(MODEL, LIMITS, 0.001)
    whole = left_as_commanded(MODEL, MODEL, poses, sides)
    with_tables = left_as_commanded(rest, MODEL, poses, sides, tables.readings)
    without = left_as_commanded(rest, MODEL, poses, sides)
    assert whole.max_mm < 1e-6 < with_tables.max_mm < 0.003
    assert without.mean_mm > 20 * with_tables.mean_mm


def test_joints_keep_the_side_that_they_came_from_while_they_stand():
    joints = np.array([[0.0, 1.0], [0.1, 1.0], [0.1, 0.9], [0.0, 0.9]])
    assert approach_along(joints).tolist() == [[0, 0], [1, 0], [1, -1], [-1, -1]]
