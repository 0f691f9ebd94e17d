"""Programs for controllers out of reach: to each shot, by safe ways, standing still there."""

import csv
import shutil
from itertools import pairwise

import numpy as np
import pytest
from command_line import change

from app.main import run_command
from app.new_campaign import create_for_devices
from campaigns.campaign import open_campaign
from campaigns.campaign_state import present_state, state_of
from campaigns.controllers.gcode import parse_gcode
from campaigns.controllers.gcode_moves import Move, moves_of
from campaigns.controllers.program_targets import targets_of
from campaigns.controllers.programs import LANGUAGES, current_program
from campaigns.errors import OptionsInvalid
from campaigns.evidence import evaluate
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.next_step import next_step
from campaigns.options import PlanOptions, ProgramLanguage, ProgramOptions
from campaigns.planning.plan_file import plan_digest
from campaigns.robots.robot import pose_row
from campaigns.settings.sections import OFFLINE
from campaigns.workflow.importing import declared_set
from campaigns.workflow.planning import plan
from campaigns.workflow.programs import write_programs

ROUNDED = 1e-6
SMALL = {
    "plan.validation_pairs": 2,
    "validation.repeatability_approaches": 2,
    "validation.rotation_steps": 3,
    "validation.line_points": 3,
}
PLAN = PlanOptions(shots=16, model="standard")


@pytest.fixture(scope="module", params=["par4-prototype", "linear-delta"])
def campaign(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("offline") / "cell"
    create_for_devices(folder, request.param, OFFLINE, OFFLINE)
    change(folder / "campaign.yaml", SMALL)
    plan(open_campaign(folder), PLAN)
    return open_campaign(folder)


def options(language, **more):
    return ProgramOptions(program=ProgramLanguage(language), **more)


def stops(text, task):
    """Poses at which a G-code program dwells, and all that it moves to, mm and rad."""
    found, at = [], []
    for line in moves_of(parse_gcode(text, "program"), "program", task):
        if isinstance(line, Move):
            found.append(line.end)
        elif "G4" in line.codes("G"):
            at.append(found[-1])
    return np.array(at), np.array(found)


def test_gcode_stands_still_at_each_shot_of_the_plan_and_says_which_plan(campaign):
    run, before = write_programs(campaign, options("gcode", dwell_s=2.5))
    shots, robot = campaign.read_plan(), campaign.robot
    text = run.path.read_text()
    at, every = stops(text, robot.mechanism.task)
    assert np.abs(at - [pose_row(shot.pose) for shot in shots]).max() < ROUNDED
    assert text.count("G4 P2.5") == len(shots) == run.shots
    assert plan_digest(shots, robot.mechanism) in text
    digest = plan_digest(shots, robot.mechanism)
    assert current_program(campaign.folder, "run", lambda: digest) == "gcode"
    assert current_program(campaign.folder, "run", lambda: "another") == ""
    state = present_state(campaign)  # without a journal, and what judges
    assert state.program == "gcode"
    assert state == state_of(evaluate(campaign))
    assert len(stops(before.path.read_text(), robot.mechanism.task)[0]) == before.shots
    slack = np.radians(0.5) * robot.mechanism.joints[0].scale
    low, high = np.add(robot.limits.joint, (-slack, slack))
    for here, there in pairwise(every):  # G1 goes straight
        between = here + np.linspace(0.0, 1.0, 33)[:, None] * (there - here)
        joints = robot.kinematics.inverse(between).values_or_raise()
        assert low - ROUNDED < joints.min() <= joints.max() < high + ROUNDED


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_language_names_each_shot_once_and_in_order(campaign, language):
    (run,) = write_programs(campaign, options(language, stage="run", targets="joints"))
    text, shots = run.path.read_text(), campaign.read_plan()
    named = [word for word in text.split() if word.startswith("shot") and word[4:].isdecimal()]
    if language == "csv":
        named = [f"shot{row['shot']}" for row in csv.DictReader(text.splitlines()) if row["shot"]]
    assert named == [f"shot{shot.shot}" for shot in shots]
    assert text.isascii()
    with run.joints_path.open() as file:
        rows = list(csv.DictReader(file))
    axes = campaign.robot.mechanism.joints
    found = [[axis.from_file(float(row[axis.column])) for axis in axes] for row in rows]
    assert np.abs(np.subtract(found, [shot.joints for shot in shots])).max() < ROUNDED


@pytest.mark.parametrize("language", ["rapid", "krl", "vplus"])
def test_program_is_read_back_as_the_poses_of_the_plan(campaign, language):
    (run,) = write_programs(campaign, options(language, stage="run"))
    shots, task = campaign.read_plan(), campaign.robot.mechanism.task
    lines = run.path.read_text().splitlines()
    targets = targets_of("\n".join(lines), "run", language, task)
    at = [target.pose for target in targets if "passes" not in lines[target.line - 1]]
    assert np.abs(np.subtract(at, [pose_row(shot.pose) for shot in shots])).max() < ROUNDED


@pytest.mark.parametrize("by", ["parameters", "targets"])
def test_program_after_calibration_is_of_what_was_written_for_the_controller(whole, tmp_path, by):
    folder = shutil.copytree(whole.folder, tmp_path / "whole")
    if by == "targets":
        wanted = folder / "wanted.csv"
        wanted.write_text("x_mm,y_mm,z_mm,theta_deg\n0,0,-575,0\n")
        assert run_command(["correct", str(folder), "--poses", str(wanted)]) == 0
    campaign = open_campaign(folder)
    (after,) = write_programs(campaign, options("gcode", stage="after"))
    written = declared_set(campaign, "after")
    assert written.by == by
    nominal = campaign.robot.kinematics
    identified = Kinematics.of(nominal.mechanism, written.wanted)
    at, _ = stops(after.path.read_text(), nominal.mechanism.task)
    rows = list(csv.DictReader(after.joints_path.read_text().splitlines()))
    own = np.array([[float(row[f"q{n}_deg"]) for n in range(4)] for row in rows])
    held = identified if by == "parameters" else nominal
    assert np.abs(np.degrees(held.inverse(at).values) - own).max() < 1e-5
    pairs = [row["pair"] for row in rows if row["set"] == "validation"]
    unseen = [s for s in campaign.read_plan() if str(s.pair) in pairs]  # within reach, in order
    assert len(unseen) == len(pairs) >= 4
    wanted_joints = identified.inverse(np.array([pose_row(s.pose) for s in unseen])).values
    assert np.abs(own[: len(pairs)] - np.degrees(wanted_joints)).max() < 1e-5
    assert current_program(folder, "after", lambda: written.digest) == "gcode"


def test_program_after_is_refused_before_an_export_and_its_options_without_a_program(campaign):
    with pytest.raises(OptionsInvalid, match="nothing says what the controller held"):
        write_programs(campaign, options("csv", stage="after"))
    with pytest.raises(OptionsInvalid, match="--dwell is for programs"):
        ProgramOptions(dwell_s=2.0)


def test_program_of_an_older_plan_is_asked_for_again(campaign, tmp_path):
    folder = shutil.copytree(campaign.folder, tmp_path / "cell")
    before = (folder / "plan.csv").read_bytes()
    assert run_command(["plan", str(folder), "--program", "krl"]) == 0
    assert (folder / "plan.csv").read_bytes() == before
    step = next_step(state_of(evaluate(open_campaign(folder))))
    assert step.command == ("import", str(folder), "FILE", "--stage", "before")
    text = (folder / "plan.csv").read_text().splitlines()
    (folder / "plan.csv").write_text("\n".join([*text[:-1], ""]))
    step = next_step(state_of(evaluate(open_campaign(folder))))
    assert step.command == ("plan", str(folder), "--program", "LANGUAGE")
