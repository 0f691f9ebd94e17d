"""Programs for controllers out of reach: to each shot, by safe ways, standing still there."""

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import change

from app.main import run_command
from app.new_campaign import create_for_devices
from campaigns.arrays import Array
from campaigns.assessment import evaluate
from campaigns.campaign import Campaign, open_campaign
from campaigns.errors import OptionsInvalid
from campaigns.evidence import is_program_there
from campaigns.kinematics.axes import Axis
from campaigns.kinematics.model import Kinematics
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


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    folder = tmp_path_factory.mktemp("offline") / "cell"
    create_for_devices(folder, "linear-delta", OFFLINE, OFFLINE)
    change(folder / "campaign.yaml", SMALL)
    campaign = open_campaign(folder)
    plan(campaign, PlanOptions(shots=16))
    return campaign


def values_of(rows: list[dict[str, str]], axes: tuple[Axis, ...]) -> Array:
    """Values (N, k) of the columns of these axes, mm and rad."""
    return np.array([[axis.from_file(float(row[axis.column])) for axis in axes] for row in rows])


def rows_of(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text().splitlines()))


def test_program_stops_at_each_shot_of_the_plan_in_order_and_says_which_plan(planned):
    run, before = write_programs(planned, ProgramOptions(program="csv"))
    shots, mechanism, rows = planned.read_plan(), planned.robot.mechanism, rows_of(run.path)
    stops = [row for row in rows if row["shot"]]
    assert [row["shot"] for row in stops] == [str(shot.shot) for shot in shots]
    poses = values_of(stops, mechanism.task)
    assert np.abs(poses - [pose_row(shot.pose) for shot in shots]).max() < ROUNDED
    joints = values_of(rows_of(run.joints_path), mechanism.joints)
    assert np.abs(joints - [shot.joints for shot in shots]).max() < ROUNDED
    dwell_s = planned.config.settle.time_s + planned.config.tracker.measuring_time_s
    assert {float(row["dwell_s"]) for row in stops} == {dwell_s}
    assert {float(row["dwell_s"]) for row in rows if row["set"] == "passes"} <= {0.0}
    digest = plan_digest(shots, mechanism)
    assert run.path.read_text().isascii()
    assert is_program_there(planned.folder, "run", digest)
    assert len([row for row in rows_of(before.path) if row["shot"]]) == before.shots


@pytest.mark.parametrize("by", ["parameters", "targets"])
def test_program_after_calibration_is_of_what_was_written_for_the_controller(whole, tmp_path, by):
    folder = shutil.copytree(whole.folder, tmp_path / "whole")
    change(folder / "campaign.yaml", SMALL)
    if by == "targets":
        wanted = folder / "wanted.csv"
        wanted.write_text("x_mm,y_mm,z_mm,theta_deg\n0,0,-575,0\n")
        assert run_command(["correct", str(folder), "--poses", str(wanted)]) == 0
    campaign = open_campaign(folder)
    (after,) = write_programs(campaign, ProgramOptions(program="csv", stage="after"))
    written = declared_set(campaign, "after")
    assert written.by == by
    nominal, mechanism = campaign.robot.kinematics, campaign.robot.mechanism
    identified = Kinematics.of(mechanism, written.wanted)
    held = identified if by == "parameters" else nominal
    rows = rows_of(after.joints_path)
    joints = values_of(rows, mechanism.joints)
    poses = values_of([row for row in rows_of(after.path) if row["shot"]], mechanism.task)
    assert np.abs(held.inverse(poses).values - joints).max() < ROUNDED
    pairs = [row["pair"] for row in rows if row["set"] == "validation"]
    unseen = [s for s in campaign.read_plan() if str(s.pair) in pairs]  # within reach, in order
    assert len(unseen) == len(pairs) >= 4
    wanted_joints = identified.inverse(np.array([pose_row(s.pose) for s in unseen])).values
    assert np.abs(joints[: len(pairs)] - wanted_joints).max() < ROUNDED
    assert is_program_there(folder, "after", written.digest)


def test_program_after_is_refused_before_an_export_and_its_options_without_a_program(planned):
    with pytest.raises(OptionsInvalid, match="nothing says what the controller held"):
        write_programs(planned, ProgramOptions(program="csv", stage="after"))
    with pytest.raises(OptionsInvalid, match="--stage is for programs"):
        ProgramOptions(stage="run")


def test_program_of_an_older_plan_is_asked_for_again(planned):
    folder = planned.folder
    assert run_command(["plan", str(folder), "--program", "csv"]) == 0
    step = next_step(state_of(evaluate(open_campaign(folder))))
    assert step.text == f"pkmcal import {folder} before.txt --stage before --unit mm"
    text = (folder / "plan.csv").read_text().splitlines()
    (folder / "plan.csv").write_text("\n".join([*text[:-1], ""]))
    step = next_step(state_of(evaluate(open_campaign(folder))))
    assert step.text == f"pkmcal plan {folder} --program csv"
