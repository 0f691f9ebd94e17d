"""Sets with plate tilt go into controllers whose kinematics has it, and whole or not at all."""

import json
import re

import pytest
from command_line import change

from app.main import run_command
from app.wiring import connected_robot
from campaigns.campaign import open_campaign
from campaigns.robots.robot import compensated, write_new_robot

EXTENSIONS = {"arm1.axis_tilt_deg": 0.02, "arm2.parallelogram_skew_deg": -0.01}


@pytest.fixture
def folder(tmp_path):
    """A campaign on a simulated cell, and a set with plate tilt to be loaded."""
    folder = tmp_path / "cell"
    assert run_command(["new", str(folder), "--scenario", "paper-simulation"]) == 0
    nominal = open_campaign(folder).nominal
    flat = nominal.robot.parameters | EXTENSIONS
    tilted = compensated(nominal, "tilted", flat)
    write_new_robot(folder / "robot-compensated.yaml", tilted)
    return folder


def held(folder):
    with connected_robot(open_campaign(folder)) as robot:
        return robot.read_geometry()


def load(folder, *options):
    return run_command(["load", str(folder), "--yes", "--json", *options])


def test_controller_that_does_not_know_a_name_gets_nothing_even_by_force(capsys, folder):
    before = held(folder)
    capsys.readouterr()
    assert load(folder, "--force", "origin") == 2
    said = capsys.readouterr()
    assert "arm1.axis_tilt_deg is 0.02" in said.err
    assert f"`pkmcal export {folder} --format plain`" in said.err
    assert "arm1.axis_tilt_deg is 0.02" in json.loads(said.out)["error"]["problem"]
    assert held(folder) == before == dict(open_campaign(folder).robot.parameters)


def test_controller_without_terms_of_gears_is_told_what_a_plain_set_loses(capsys, folder):
    nominal = open_campaign(folder).nominal
    gears = {f"arm{arm}.eccentricity_sin_deg": 0.0115 for arm in range(4)}
    gears |= {f"arm{arm}.backlash_deg": 0.005 for arm in range(4)}
    path = folder / "geared.yaml"
    write_new_robot(path, compensated(nominal, "geared", nominal.robot.parameters | gears))
    capsys.readouterr()
    assert load(folder, "--force", "origin", "--robot", str(path)) == 2
    said = capsys.readouterr().err
    assert f"`pkmcal export {folder} --format plain` writes the nearest set" in said
    (lost_mm,) = re.findall(r"which loses (\S+) mm on average", said)
    assert 0.01 < float(lost_mm) < 1.0
    assert "`pkmcal correct` loses nothing" in said


def test_controller_that_computes_plate_tilt_gets_all_and_gives_it_up_again(folder):
    change(folder / "cell.yaml", {"controller.computes_plate_tilt": True})
    nominal = dict(open_campaign(folder).robot.parameters)
    assert held(folder) == nominal
    assert load(folder, "--force", "origin") == 0
    assert held(folder) == nominal | EXTENSIONS
    assert load(folder, "--rollback") == 0
    assert held(folder) == nominal
