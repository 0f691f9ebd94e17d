"""The whole chain with the real LinuxCNC: it moves, the hidden robot follows its joints, and the
identified parameters go into its own kinematics.
"""

import json
from functools import partial
from pathlib import Path

import pytest
from linuxcnc_bench import IDENTITY, NEEDS_LINUXCNC, NOMINAL, PATIENT, world_controller
from ruamel.yaml import YAML

from app import wiring
from app.main import run_command
from campaigns.controllers.linuxcnc_export import RobotIdentity, parse_hal
from campaigns.robots.robot import read_robot
from drivers.linuxcnc.settings import LinuxcncSettings

pytestmark = [*NEEDS_LINUXCNC, pytest.mark.timeout(240)]

WHOSE = RobotIdentity(IDENTITY, NOMINAL)
SMALL = {
    "plan.shots": 48,
    "plan.validation_pairs": 5,
    "settle.time_s": 0.05,
    "controller.speed_percent": 100.0,
}
BAD_BEFORE_MM = 1.0
GOOD_AFTER_MM = 0.05


def change(path, settings):
    """Set keys of a YAML file, named like `plan.shots`."""
    yaml = YAML()
    tree = yaml.load(path.read_text(encoding="utf-8"))
    for name, value in settings.items():
        *sections, key = name.split(".")
        section = tree
        for step in sections:
            section = section.setdefault(step, {})
        section[key] = value
    with path.open("w", encoding="utf-8") as file:
        yaml.dump(tree, file)


@pytest.fixture
def linuxcnc(tmp_path):
    with world_controller(tmp_path) as running:
        yield running


@pytest.fixture(autouse=True)
def _patient_driver(monkeypatch):
    patient = partial(LinuxcncSettings, deadlines=PATIENT)
    monkeypatch.setattr(wiring, "LinuxcncSettings", patient)


@pytest.fixture
def campaign(linuxcnc, tmp_path):
    """A campaign whose controller is LinuxCNC, and whose hidden robot follows its joints."""
    folder = tmp_path / "campaign"
    assert run_command(["new", str(folder), "--scenario", "paper-simulation"]) == 0
    settings = {
        "coordinates": "world",
        "hal_file": str(linuxcnc.config / "calib.hal"),
        "beside": str(linuxcnc.beside),
    }
    address = {"controller.driver": "linuxcnc", "controller.url": linuxcnc.url}
    change(folder / "campaign.yaml", SMALL | address | {"controller.linuxcnc": settings})
    change(folder / "cell.yaml", {"controller.joints_from": f"hal:{linuxcnc.beside}"})
    return folder


def test_campaign_on_linuxcnc_makes_its_own_cartesian_moves_exact(campaign, linuxcnc, capsys):
    def pkmcal(command, *options):
        capsys.readouterr()
        assert run_command([command, str(campaign), *options, "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    assert "PAR4" in pkmcal("devices")["controller"]["identity"]
    pkmcal("plan")
    distances = ("--only", "distances", "--yes")
    before = pkmcal("validate", "--stage", "before", *distances)
    pkmcal("run", "--yes")
    assert pkmcal("identify")["verdict"] == "pass"
    pkmcal("export")
    exported = pkmcal("export", "--format", "linuxcnc")["path"]
    pkmcal("load", "--yes")
    after = pkmcal("validate", "--stage", "after", *distances)

    assert before["distances_mm"]["max_abs"] > BAD_BEFORE_MM
    assert after["distances_mm"]["max_abs"] < GOOD_AFTER_MM
    compensated = read_robot(campaign / "robot-compensated.yaml").robot.geometry_flat()
    calib = linuxcnc.config / "calib.hal"
    for text in (calib.read_text(), Path(exported).read_text()):
        assert parse_hal(text, "calib.hal", WHOSE).geometry_flat() == compensated

    pkmcal("load", "--rollback", "--yes")
    back = parse_hal(calib.read_text(), "calib.hal", WHOSE).geometry_flat()
    assert back == NOMINAL.geometry_flat()
