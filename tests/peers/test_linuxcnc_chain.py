"""The whole chain with the real LinuxCNC: it moves, the hidden robot follows its joints, and the
identified parameters go into its own kinematics.
"""

import json
from pathlib import Path

import pytest
from linuxcnc_bench import NEEDS_LINUXCNC, world_controller
from linuxcnc_campaign import made_campaign, patient_driver, tell

from app.main import run_command
from campaigns.controllers.linuxcnc_export import RobotIdentity, parse_hal
from campaigns.robots.robot import find_robot, read_robot

pytestmark = [*NEEDS_LINUXCNC, pytest.mark.timeout(240)]

VARIANTS = {"par4-prototype": "cartesian", "delta": "delta", "linear-delta": "linear-delta"}
SMALL = {"plan.shots": 48, "plan.validation_pairs": 5, "settle.time_s": 0.05}
BAD_BEFORE_MM = 1.0
GOOD_AFTER_MM = 0.05


OFTEN = "linear-delta"
"""A minute each: the others are for `make long`."""


@pytest.fixture(
    params=[
        pytest.param(each, marks=[] if each == OFTEN else pytest.mark.long) for each in VARIANTS
    ]
)
def name(request):
    return request.param


@pytest.fixture
def linuxcnc(tmp_path, name):
    with world_controller(tmp_path, VARIANTS[name]) as running:
        yield running


@pytest.fixture(autouse=True)
def _patient_driver(monkeypatch, tmp_path):
    patient_driver(monkeypatch, tmp_path)


@pytest.fixture
def campaign(linuxcnc, tmp_path, name):
    return made_campaign(tmp_path / "campaign", linuxcnc, name, SMALL)


def test_campaign_on_linuxcnc_makes_its_own_cartesian_moves_exact(campaign, linuxcnc, name, capsys):
    nominal = find_robot(name).robot
    whose = RobotIdentity(name, nominal)

    def pkmcal(command, *options):
        capsys.readouterr()
        assert run_command([command, str(campaign), *options, "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    assert nominal.mechanism.name.upper() in pkmcal("devices")["controller"]["identity"]
    pkmcal("plan")
    distances = ("--only", "distances", "--yes")
    before = pkmcal("validate", "--stage", "before", *distances)
    pkmcal("run", "--yes")
    assert pkmcal("identify")["verdict"] == "pass"
    pkmcal("export")
    exported = pkmcal("export", "--format", "linuxcnc")["path"]
    pkmcal("load", "--yes")
    after = pkmcal("validate", "--stage", "after", *distances)

    with capsys.disabled():
        tell(f"{name}: distances before {before['distances_mm']}, after {after['distances_mm']}")
    assert before["distances_mm"]["max_abs"] > BAD_BEFORE_MM
    assert after["distances_mm"]["max_abs"] < GOOD_AFTER_MM
    compensated = dict(read_robot(campaign / "robot-compensated.yaml").robot.parameters)
    calib = linuxcnc.config / "calib.hal"
    for text in (calib.read_text(), Path(exported).read_text()):
        assert dict(parse_hal(text, "calib.hal", whose).parameters) == compensated

    pkmcal("load", "--rollback", "--yes")
    back = parse_hal(calib.read_text(), "calib.hal", whose).parameters
    assert back == dict(nominal.parameters)
