"""Programs for controllers out of reach: to each shot, by safe ways, standing still there."""

import csv
import shutil

import numpy as np
import pytest
from command_line import change

from app.main import run_command
from app.new_campaign import create_for_devices
from campaigns.campaign import open_campaign
from campaigns.errors import OptionsInvalid
from campaigns.evidence import evaluate, is_program_there
from campaigns.kinematics.mechanism import Kinematics
from campaigns.next_step import next_step, state_of
from campaigns.options import PlanOptions, ProgramOptions
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
PLAN = PlanOptions(shots=16)


@pytest.fixture(scope="module", params=["par4-prototype", "linear-delta"])
def campaign(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("offline") / "cell"
    create_for_devices(folder, request.param, OFFLINE, OFFLINE)
    change(folder / "campaign.yaml", SMALL)
    plan(open_campaign(folder), PLAN)
    return open_campaign(folder)


def stops(path, task):
    """Poses (N, t) of the shots of a program, mm and rad, and the rows of all stops."""
    rows = list(csv.DictReader(path.read_text().splitlines()))
    at = [[axis.from_file(float(row[axis.column])) for axis in task] for row in rows if row["shot"]]
    return np.array(at), rows


def test_program_stops_at_each_shot_of_the_plan_in_order_and_says_which_plan(campaign):
    run, before = write_programs(campaign, ProgramOptions(program="csv"))
    shots, robot = campaign.read_plan(), campaign.robot
    at, rows = stops(run.path, robot.mechanism.task)
    assert np.abs(at - [pose_row(shot.pose) for shot in shots]).max() < ROUNDED
    assert [row["shot"] for row in rows if row["shot"]] == [str(shot.shot) for shot in shots]
    config = campaign.config
    dwell_s = config.settle.time_s + config.tracker.measuring_time_s
    assert {(row["set"] == "passes", float(row["dwell_s"])) for row in rows} >= {(False, dwell_s)}
    text, digest = run.path.read_text(), plan_digest(shots, robot.mechanism)
    assert text.isascii()
    assert digest in text
    assert is_program_there(campaign.folder, "run", digest)
    assert not is_program_there(campaign.folder, "run", "another")
    assert state_of(evaluate(campaign)).program
    assert len(stops(before.path, robot.mechanism.task)[0]) == before.shots


def test_joints_of_a_program_are_those_of_the_plan(campaign):
    (run,) = write_programs(campaign, ProgramOptions(program="csv", stage="run"))
    with run.joints_path.open() as file:
        rows = list(csv.DictReader(file))
    axes = campaign.robot.mechanism.joints
    found = [[axis.from_file(float(row[axis.column])) for axis in axes] for row in rows]
    assert (
        np.abs(np.subtract(found, [shot.joints for shot in campaign.read_plan()])).max() < ROUNDED
    )


@pytest.mark.parametrize("by", ["parameters", "targets"])
def test_program_after_calibration_is_of_what_was_written_for_the_controller(whole, tmp_path, by):
    folder = shutil.copytree(whole.folder, tmp_path / "whole")
    if by == "targets":
        wanted = folder / "wanted.csv"
        wanted.write_text("x_mm,y_mm,z_mm,theta_deg\n0,0,-575,0\n")
        assert run_command(["correct", str(folder), "--poses", str(wanted)]) == 0
    campaign = open_campaign(folder)
    (after,) = write_programs(campaign, ProgramOptions(program="csv", stage="after"))
    written = declared_set(campaign, "after")
    assert written.by == by
    nominal = campaign.robot.kinematics
    identified = Kinematics.of(nominal.mechanism, written.wanted)
    at, _ = stops(after.path, nominal.mechanism.task)
    rows = list(csv.DictReader(after.joints_path.read_text().splitlines()))
    own = np.array([[float(row[f"q{n}_deg"]) for n in range(4)] for row in rows])
    held = identified if by == "parameters" else nominal
    assert np.abs(np.degrees(held.inverse(at).values) - own).max() < 1e-5
    pairs = [row["pair"] for row in rows if row["set"] == "validation"]
    unseen = [s for s in campaign.read_plan() if str(s.pair) in pairs]  # within reach, in order
    assert len(unseen) == len(pairs) >= 4
    wanted_joints = identified.inverse(np.array([pose_row(s.pose) for s in unseen])).values
    assert np.abs(own[: len(pairs)] - np.degrees(wanted_joints)).max() < 1e-5
    assert is_program_there(folder, "after", written.digest)


def test_program_after_is_refused_before_an_export_and_its_options_without_a_program(campaign):
    with pytest.raises(OptionsInvalid, match="nothing says what the controller held"):
        write_programs(campaign, ProgramOptions(program="csv", stage="after"))
    with pytest.raises(OptionsInvalid, match="--stage is for programs"):
        ProgramOptions(stage="run")


def test_program_of_an_older_plan_is_asked_for_again(campaign, tmp_path):
    folder = shutil.copytree(campaign.folder, tmp_path / "cell")
    before = (folder / "plan.csv").read_bytes()
    assert run_command(["plan", str(folder), "--program", "csv"]) == 0
    assert (folder / "plan.csv").read_bytes() == before
    step = next_step(state_of(evaluate(open_campaign(folder))))
    assert step.text == f"pkmcal import {folder} before.txt --stage before"
    text = (folder / "plan.csv").read_text().splitlines()
    (folder / "plan.csv").write_text("\n".join([*text[:-1], ""]))
    step = next_step(state_of(evaluate(open_campaign(folder))))
    assert step.text == f"pkmcal plan {folder} --program csv"
