"""Every mechanism of the family through the whole chain, on a simulated cell of its own parts."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from command_line import SMALL_TESTS, change
from family_cases import MEMBERS, of_members

from campaigns.kinematics.model import Kinematics
from campaigns.robots.robot import find_robot
from sim.factory import true_geometry
from sim.scenarios.scenario import load_scenario

pytestmark = pytest.mark.long
SMALL = {"plan.shots": 30, "plan.validation_pairs": 4, **SMALL_TESTS}
FAST = {
    "speed_up": 1000,
    "controller.computes_plate_tilt": True,
    "controller.computes_transmission": True,
}

all_members = pytest.mark.parametrize("member", MEMBERS, ids=lambda each: each.name)


@pytest.fixture
def new(pkmcal, tmp_path):
    """Makes a member's new campaign on a simulated cell."""

    def make(member):
        words = ("--robot", member.name, "--scenario", "paper-simulation")
        assert pkmcal("new", tmp_path / member.name, *words).code == 0
        change(tmp_path / member.name / "campaign.yaml", SMALL)
        change(tmp_path / member.name / "cell.yaml", FAST)
        return tmp_path / member.name

    return make


@of_members("i4r")
def test_a_reflector_on_half_2_is_said_in_the_robot_file(pkmcal, new, member):
    """Parameters are as true as from half 1, and poses that hold its point do hold it."""
    folder = new(member)
    change(folder / "cell.yaml", {"robot.reflector.half": 2})
    with (folder / "robot.yaml").open("a", encoding="utf-8") as file:
        file.write("reflector_half: 2\n")
    change(folder / "campaign.yaml", {"validation.rotation_steps": 5})
    ended = pkmcal("dry-run", folder, "--json")
    assert ended.code == 0, ended.err
    after = ended.document["after"]
    assert max(after["distances_mm"]["max_abs"], after["frame_mm"]["max"]) < 0.1
    assert after["rotation_mm"] < 0.1
    memory = json.loads((folder / "cell-memory.json").read_text(encoding="utf-8"))
    assert "arm0.plate_joint_x_mm" in memory["geometry"]
    assert "reflector_x_mm" not in memory["geometry"]
    assert "nothing is left to do" in pkmcal("status", folder).out
    assert pkmcal("load", folder, "--rollback", "--yes").code == 0
    by = ("--stage", "after", "--by", "targets", "--force", "--yes")
    by_targets = pkmcal("validate", folder, *by, "--json").document
    assert by_targets["distances_mm"]["max_abs"] < 0.1
    assert by_targets["rotation_mm"] < 0.1


def true_robot(member, folder):
    """The cell's robot, its base frame anywhere."""
    scenario = load_scenario(str(folder / "cell.yaml"))
    return Kinematics.of(member.mechanism, true_geometry(scenario.robot, scenario.seed))


@all_members
def test_a_dry_run_finds_the_errors_and_proves_the_gain(pkmcal, new, member):
    folder = new(member)
    ended = pkmcal("dry-run", folder, "--json")
    assert ended.code == 0, ended.err
    before, after = ended.document["before"], ended.document["after"]
    assert before["distances_mm"]["mean_abs"] > 0.2
    assert after["distances_mm"]["max_abs"] < 0.1
    assert after["distances_mm"]["mean_abs"] < 0.1 * before["distances_mm"]["mean_abs"]
    assert after["frame_mm"]["max"] < 0.1
    has_turn = len(member.mechanism.task) > 3
    assert (after["rotation_mm"] is not None) == has_turn
    if has_turn:
        assert after["rotation_mm"] < 0.5 * before["rotation_mm"]
    assert_found(ended.document["identification"], true_robot(member, folder), member)
    assert_loaded(folder, member)
    assert_files(folder, member)
    assert_report(Path(ended.document["report"]), has_turn)


def assert_found(document, truth, member):
    """Positions of the identified robot are the cell's within three σ, the frame best fitted."""
    values = {name: entry["value"] for name, entry in document["parameters"].items()}
    apart = member.apart_mm(Kinematics.of(member.mechanism, values), truth)
    assert np.sqrt(np.mean(apart**2)) < 3.0 * document["position_std_mm"]["rms"]


def assert_loaded(folder, member):
    """The controller's parameters are those of the exported file."""
    robot = find_robot(str(folder / "robot-compensated.yaml")).robot
    memory = json.loads((folder / "cell-memory.json").read_text(encoding="utf-8"))
    assert memory["geometry"] == dict(robot.parameters)
    assert memory["mechanism"] == member.name


def assert_files(folder, member):
    """The plan's columns are the mechanism's own: as many joints, in their unit."""
    with (folder / "plan.csv").open(encoding="utf-8", newline="") as file:
        head = next(csv.reader(file))
    task, joints = (
        [axis.column for axis in axes] for axes in (member.mechanism.task, member.mechanism.joints)
    )
    assert head == ["shot", "set", "pair", *task, *joints]


def assert_report(path, has_turn):
    page = path.read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>")
    assert ('<figure id="rotation"' in page) == has_turn


@of_members("i4l", "linear-delta")
def test_the_fewest_best_shots_are_planned_and_a_study_finds_its_drawn_robots(pkmcal, new, member):
    folder = new(member)
    words = ("--placement", "optimal", "--shots", "24", "--json")
    planned = pkmcal("plan", folder, *words)
    assert planned.code == 0, planned.err
    assert planned.document["placement"] == "optimal"
    assert planned.document["position_std_mm"]["mean"] < 0.1
    studied = pkmcal("study", folder, "--campaigns", "4", "--workers", "1", "--json")
    assert studied.code == 0, studied.err
    assert studied.document
