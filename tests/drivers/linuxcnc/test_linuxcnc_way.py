"""Ways of poses that keep the joints within their limits."""

from math import degrees, radians

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scripted_linuxcnc import Straight, ready, told

from drivers.errors import LimitViolation
from drivers.linuxcnc.moves import way_to
from drivers.linuxcnc.settings import Coordinates
from drivers.values import Pose

MACHINE = told()
LOW, HIGH = radians(-45.0), radians(90.0)
HALF = 0.5


class Curved:
    """The first joint bulges out by some degrees on straight lines of poses."""

    def __init__(self, bulge_deg):
        self.bulge_rad = radians(bulge_deg)

    def joints(self, pose):
        return (pose.x_mm - self._sag(pose), pose.y_mm, pose.z_mm, pose.theta_rad)

    def pose(self, joints):
        x, y, z, theta = joints
        return Pose(x + self._sag(Pose(x, y, z, theta)), y, z, theta)

    def _sag(self, pose):
        """A parabola over the second coordinate, so that chords lie below it."""
        return self.bulge_rad * (1.0 - (pose.y_mm / HALF) ** 2)


def test_straight_line_within_limits_is_the_whole_way_and_none_is_told_before():
    way = way_to(Straight({"plate_mm": 100.0}), MACHINE, (0.0,) * 4, (0.1,) * 4)
    assert way == (Straight({"plate_mm": 100.0}).pose((0.1,) * 4),)
    kinematics = Curved(6.0)
    way = way_to(kinematics, MACHINE, (LOW, -HALF, 0, 0), (LOW, HALF, 0.5, 0.25))
    assert kinematics.joints(way[-1]) == pytest.approx((LOW, HALF, 0.5, 0.25))
    with pytest.raises(LimitViolation, match=r"-45\.5° to 90\.5° on 16 straight parts"):
        way_to(Curved(2000.0), MACHINE, (LOW, -HALF, 0, 0), (LOW, HALF, 0, 0))


@pytest.mark.parametrize(("bulge_deg", "parts"), [(0.4, 1), (1.5, 2), (6.0, 4), (20.0, 8)])
def test_line_that_leaves_the_limits_is_divided_as_little_as_it_takes(bulge_deg, parts):
    kinematics = Curved(bulge_deg)
    assert len(way_to(kinematics, MACHINE, (LOW, -HALF, 0, 0), (LOW, HALF, 0, 0))) == parts


@given(
    st.floats(0.1, 30.0),
    st.tuples(*[st.floats(LOW, HIGH)] * 4),
    st.tuples(*[st.floats(LOW, HIGH)] * 4),
)
def test_every_way_keeps_the_limits_wherever_it_is_looked_at(bulge_deg, from_rad, to_rad):
    kinematics = Curved(bulge_deg)
    try:
        way = way_to(kinematics, MACHINE, from_rad, to_rad)
    except LimitViolation:
        return
    here = kinematics.pose(from_rad)
    for there in way:
        middle = (
            (a + b) / 2
            for a, b in zip(
                (here.x_mm, here.y_mm, here.z_mm, here.theta_rad),
                (there.x_mm, there.y_mm, there.z_mm, there.theta_rad),
                strict=True,
            )
        )
        MACHINE.check(kinematics.joints(Pose(*middle)), slack=MACHINE.passing_slack)
        here = there
    assert degrees(kinematics.joints(here)[0] - to_rad[0]) == pytest.approx(0.0, abs=1e-9)


def test_parts_of_a_way_are_ordered_one_after_the_other():
    linuxcnc = ready(Coordinates.WORLD)
    linuxcnc.start_deg = linuxcnc.target_deg = (-45.0, degrees(-HALF), 0.0, 0.0)
    linuxcnc.robot._poses_of = Curved(1.5)
    linuxcnc.robot.move_joints((LOW, HALF, 0.0, 0.0), 1.0)
    assert len(linuxcnc.moves) == 2
    assert "Y0.000000" in linuxcnc.moves[0]
    assert "Y0.500000" in linuxcnc.moves[1]


def test_joint_move_of_a_controller_that_takes_joints_needs_no_way(linuxcnc):
    linuxcnc.robot.move_joints((LOW, 0.4, 0.0, 0.0), 1.0)
    assert len(linuxcnc.moves) == 1
