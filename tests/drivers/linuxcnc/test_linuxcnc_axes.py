"""Robots of three joints and of carriages: their letters, units and limits."""

from math import radians

import pytest
from scripted_linuxcnc import ScriptedLinuxcnc, connected, told

from drivers.errors import LimitViolation, WrongDevice
from drivers.linuxcnc.settings import Coordinates

DELTA = {"robot": "Delta", "joints": 3, "has_turn": False}
CARRIAGES = {
    "robot": "Linear-delta",
    "joints": 3,
    "are_rotary": False,
    "has_turn": False,
    "lowest": -450.0,
    "highest": 450.0,
}


@pytest.mark.parametrize(
    ("robot", "joints", "world"), [({}, "XYZA", "XYZC"), (DELTA, "XYZ", "XYZ")]
)
def test_letters_are_those_of_the_joints_or_of_the_coordinates(robot, joints, world):
    assert told(coordinates=Coordinates.JOINTS, **robot).letters == joints
    assert told(coordinates=Coordinates.WORLD, **robot).letters == world


def test_units_limits_and_slack_are_the_joints():
    assert told(**DELTA).from_machine(180.0) == pytest.approx(radians(180.0))
    assert told(**DELTA).to_machine(radians(30.0)) == pytest.approx(30.0)
    carriages = told(**CARRIAGES)
    assert carriages.from_machine(180.0) == carriages.to_machine(180.0) == 180.0
    with pytest.raises(LimitViolation, match=r"joint 2 to 450\.5000 mm, limits -450 mm to 450 mm"):
        told(**CARRIAGES).check((0.0, 0.0, 450.5))
    with pytest.raises(LimitViolation, match="4 joints were given, the robot has 3"):
        told(**CARRIAGES).check((0.0, 0.0, 0.0, 0.0))
    assert told(**CARRIAGES).passing_slack == 5.0
    assert told(**DELTA).passing_slack == pytest.approx(radians(0.5))


def test_carriages_are_found_among_the_joints_that_linuxcnc_tells_of():
    linuxcnc = ScriptedLinuxcnc(Coordinates.WORLD, facts=CARRIAGES)
    linuxcnc.types = ["LINEAR"] * 9
    linuxcnc.robot.connect()
    assert linuxcnc.robot.identity().model == "Linear-delta in XYZ"


@pytest.mark.parametrize(
    ("types", "said"),
    [
        (["ANGULAR"] * 4 + ["LINEAR"] * 5, "0 linear joints .* a Linear-delta has 3"),
        (["LINEAR", "LINEAR", "ANGULAR"], "2 linear joints"),
        (["LINEAR"] * 3 + ["ANGULAR"], "3 linear joints .*ANGULAR"),
    ],
)
def test_machine_of_other_joints_is_not_taken_for_carriages(types, said):
    linuxcnc = ScriptedLinuxcnc(Coordinates.WORLD, facts=CARRIAGES)
    linuxcnc.types = types
    with pytest.raises(WrongDevice, match=said) as error:
        linuxcnc.robot.connect()
    assert "TYPE = LINEAR for joints 0 to 2" in error.value.remedy


def test_par4_is_what_is_expected_unless_told_otherwise():
    assert connected().robot.identity().model == "Par4 in XYZA"
