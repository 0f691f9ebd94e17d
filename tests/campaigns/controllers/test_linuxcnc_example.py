"""The example configurations fit the robot that they are for."""

import configparser
import math
import re
from pathlib import Path

import pytest
from par4_space import ARM_FIELDS
from ruamel.yaml import YAML

from campaigns.controllers.linuxcnc_export import PIN_OF, RobotIdentity, parse_hal
from campaigns.errors import ConfigInvalid
from campaigns.files.yaml_file import checked_settings
from campaigns.robots.robot import find_robot
from campaigns.settings.sections import LinuxcncConfig

ROOT = Path(__file__).parents[3]
EXAMPLES = ROOT / "examples" / "linuxcnc"
NOMINAL = find_robot("par4-prototype").robot
PASSING_DEG = 0.5


def ini(variant):
    parser = configparser.ConfigParser(strict=False, inline_comment_prefixes=None)
    parser.read(EXAMPLES / variant / "par4.ini")
    return parser


def test_calibration_of_the_example_is_the_nominal_robot():
    text = (EXAMPLES / "cartesian" / "calib.hal").read_text()
    found = parse_hal(text, "calib.hal", RobotIdentity("par4-prototype", NOMINAL))
    assert found.geometry_flat() == NOMINAL.geometry_flat()


@pytest.mark.parametrize("variant", ["joints", "cartesian"])
def test_soft_limits_leave_joints_room_to_pass(variant):
    low, high = map(math.degrees, NOMINAL.limits.joint)
    for joint in range(4):
        section = ini(variant)[f"JOINT_{joint}"]
        assert float(section["MIN_LIMIT"]) <= low - PASSING_DEG
        assert float(section["MAX_LIMIT"]) >= high + PASSING_DEG


def test_kinematics_module_names_its_pins_after_the_parameters():
    source = (EXAMPLES / "par4kins" / "par4kins.c").read_text()
    fields = re.search(r"field_name\[FIELDS\] = \{([^}]*)\}", source)
    assert tuple(re.findall(r'"(\w+)"', fields[1])) == ARM_FIELDS
    assert '"par4kins.arm%d.%s"' in source
    assert f'"{PIN_OF["plate_mm"]}"' in source


def test_kinematics_module_and_its_folder_declare_their_licence():
    for file in ("par4kins.c", "par4_model.h"):
        first = (EXAMPLES / "par4kins" / file).read_text().splitlines()[0]
        assert first == "/* SPDX-License-Identifier: GPL-2.0-or-later"
    assert "GPL-2.0-or-later" in (EXAMPLES / "par4kins" / "LICENSE.md").read_text()


def documented_settings():
    """The `linuxcnc` sections that the documentation shows."""
    text = (ROOT / "docs" / "linuxcnc.md").read_text(encoding="utf-8")
    for block in re.findall(r"```(?:yaml|text)\n(.*?)```", text, re.DOTALL):
        tree = YAML(typ="safe").load(block)
        section = tree.get("controller", tree).get("linuxcnc")
        if section:
            yield section


def test_settings_in_the_documentation_are_valid():
    found = [checked_settings(s, "docs/linuxcnc.md", LinuxcncConfig) for s in documented_settings()]
    assert [section.coordinates for section in found] == ["world", "world"]
    assert found[1].beside == "ssh operator@controller"


def test_world_coordinates_need_the_hal_file():
    with pytest.raises(ConfigInvalid, match="no hal_file"):
        checked_settings({"coordinates": "world"}, "campaign.yaml", LinuxcncConfig)
    joints = checked_settings({"coordinates": "joints"}, "campaign.yaml", LinuxcncConfig)
    assert joints.full_speed_rad_s == pytest.approx(math.pi)
