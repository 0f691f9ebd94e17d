"""Robots of three joints and of carriages: their letters, units and limits."""

from math import radians

import pytest
from scripted_linuxcnc import ScriptedLinuxcnc, connected

from drivers.errors import LimitViolation, WrongDevice
from drivers.linuxcnc.settings import Coordinates, JointLimits, LinuxcncSettings, MachineAxes

PAR4 = MachineAxes()
DELTA = MachineAxes("Delta", 3, are_rotary=True, has_turn=False)
CARRIAGES = MachineAxes("Linear-delta", 3, are_rotary=False, has_turn=False)
TRAVEL = JointLimits(-450.0, 450.0, CARRIAGES)


@pytest.mark.parametrize(
    ("axes", "joints", "world"), [(PAR4, "XYZA", "XYZC"), (DELTA, "XYZ", "XYZ")]
)
def test_letters_are_those_of_the_joints_or_of_the_coordinates(axes, joints, world):
    assert axes.letters(Coordinates.JOINTS) == joints
    assert axes.letters(Coordinates.WORLD) == world


def test_motors_are_told_in_degrees_and_carriages_in_millimetres():
    assert DELTA.from_machine(180.0) == pytest.approx(radians(180.0))
    assert DELTA.to_machine(radians(30.0)) == pytest.approx(30.0)
    assert CARRIAGES.from_machine(180.0) == CARRIAGES.to_machine(180.0) == 180.0


def test_limits_are_told_in_the_joints_unit():
    with pytest.raises(LimitViolation, match=r"joint 2 to 450\.5000 mm, limits -450 mm to 450 mm"):
        TRAVEL.check((0.0, 0.0, 450.5))
    with pytest.raises(LimitViolation, match="4 joints were given, the robot has 3"):
        TRAVEL.check((0.0, 0.0, 0.0, 0.0))


def test_joints_may_pass_their_limits_by_half_a_degree_or_five_millimetres():
    motors = JointLimits(radians(-40.0), radians(85.0), DELTA)
    assert LinuxcncSettings(Coordinates.WORLD, TRAVEL, 1.0).passing.highest == 455.0
    passing = LinuxcncSettings(Coordinates.WORLD, motors, 1.0).passing
    assert passing.lowest == pytest.approx(radians(-40.5))


def test_carriages_are_found_among_the_joints_that_linuxcnc_tells_of():
    linuxcnc = ScriptedLinuxcnc(Coordinates.WORLD, limits=TRAVEL)
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
    linuxcnc = ScriptedLinuxcnc(Coordinates.WORLD, limits=TRAVEL)
    linuxcnc.types = types
    with pytest.raises(WrongDevice, match=said) as error:
        linuxcnc.robot.connect()
    assert "TYPE = LINEAR for joints 0 to 2" in error.value.remedy


def test_par4_is_what_is_expected_unless_told_otherwise():
    assert connected().robot.identity().model == "Par4 in XYZA"
