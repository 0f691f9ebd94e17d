"""The example configurations fit the robot that they are for."""

import configparser
import re
from pathlib import Path

import pytest
from hal_files import parameters_of

from campaigns.controllers.linuxcnc_export import drawing_pins
from campaigns.kinematics.catalog import FAMILY
from campaigns.robots.robot import find_robot

ROOT = Path(__file__).parents[3]
EXAMPLES = ROOT / "examples" / "linuxcnc"
ROBOTS = {"cartesian": "par4-prototype", "delta": "delta", "linear-delta": "linear-delta"}
PASSING = {"deg": 0.5, "mm": 5.0}


def ini(variant):
    parser = configparser.ConfigParser(strict=False, inline_comment_prefixes=None)
    (file,) = (EXAMPLES / variant).glob("*.ini")
    parser.read(file)
    return parser


@pytest.mark.parametrize("variant", ROBOTS)
def test_calibration_of_the_example_is_the_nominal_robot(variant):
    nominal = find_robot(ROBOTS[variant]).robot
    text = (EXAMPLES / variant / "calib.hal").read_text()
    assert parameters_of(text, nominal.mechanism) == dict(nominal.parameters)


@pytest.mark.parametrize("variant", ROBOTS)
def test_example_has_the_robots_kinematics_and_joints_with_room_to_pass_their_limits(variant):
    robot, settings = find_robot(ROBOTS[variant]).robot, ini(variant)
    mechanism, joints = robot.mechanism, robot.mechanism.joints
    assert settings["KINS"]["KINEMATICS"] == f"pkmkins type={mechanism.name}"
    assert settings["TRAJ"]["COORDINATES"] == ("XYZC" if len(mechanism.task) > 3 else "XYZ")
    assert int(settings["KINS"]["JOINTS"]) == len(joints)
    assert f"JOINT_{len(joints)}" not in settings
    for number, joint in enumerate(joints):
        section = settings[f"JOINT_{number}"]
        low, high = map(joint.to_file, robot.limits.joint)
        assert section["TYPE"] == ("ANGULAR" if joint.is_revolute else "LINEAR")
        assert float(section["MIN_LIMIT"]) <= low - PASSING[joint.unit]
        assert float(section["MAX_LIMIT"]) >= high + PASSING[joint.unit]


@pytest.mark.parametrize("name", FAMILY)
def test_kinematics_module_names_its_pins_after_the_parameters(name):
    mechanism = find_robot("par4-prototype" if name == "par4" else name).robot.mechanism
    source = (EXAMPLES / "pkmkins" / "pkmkins.c").read_text()
    arm = "crank" if mechanism.joints[0].is_revolute else "rail"
    table = re.search(rf"{arm}_fields\[FIELDS\] = \{{([^}}]*)\}}", source)[1]
    fields = re.findall(r'"(\w+)"', table)
    space = mechanism.parameters
    of_arms = {f"arm{arm}.{field}" for arm in range(space.arms) for field in fields}
    drawing = {pin.removeprefix("pkmkins.") for pin in drawing_pins(mechanism) if ".arm" in pin}
    platform = {field.name for field in space.platform_fields()}
    sag = {*space.select(group="sag")}
    others = {*space.select(group="backlash"), *space.select(group="reflector"), *sag}
    known = {*space.of_robot} - others
    assert of_arms | platform == known | drawing
    assert all(f'"{field}"' in source for field in platform | sag)
    assert '"pkmkins.arm%d.%s"' in source
    assert '"pkmkins.reflector_%c_mm"' in source
    assert '"pkmkins.fitted.reflector_%c_mm"' in source
    assert f'{{"{name}", {space.arms}, ' in (EXAMPLES / "pkmkins" / "pkm_robot.h").read_text()


def test_kinematics_module_and_its_folder_declare_their_licence():
    files = sorted((EXAMPLES / "pkmkins").glob("*.[ch]"))
    assert len(files) == 5
    for file in files:
        assert file.read_text().splitlines()[0] == "/* SPDX-License-Identifier: GPL-2.0-or-later"
    assert "GPL-2.0-or-later" in (EXAMPLES / "pkmkins" / "LICENSE.md").read_text()
