"""`pkmcal history`: one robot over campaigns, checks and repairs, on the terminal and in files."""

import csv
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import paper_campaign
import pytest
from par4_space import par4, with_values
from pydantic import TypeAdapter

from campaigns.evaluation.calibration_check import CalibrationCheck, PartChange
from campaigns.journal.records import Finding

DRIFTING = "arm2.joint_offset_deg"


@pytest.fixture
def at(tmp_path, monkeypatch):
    """Campaigns measured in a month, the offset of one joint so much later."""

    def made(month, later_deg=0.0, **settings):
        nominal, errors = paper_campaign.NOMINAL.robot.parameters, dict(paper_campaign.ERRORS)
        errors[DRIFTING] += later_deg
        true = par4(nominal | {name: nominal[name] + error for name, error in errors.items()})
        monkeypatch.setattr(paper_campaign, "TRUE", true)
        paper = paper_campaign.new_campaign(tmp_path / f"m{month}", **settings)
        paper.rng = np.random.default_rng(month)
        paper.clock = paper_campaign.Clock(datetime(2026, month, 2, tzinfo=UTC))
        paper.run(pairs=20, unseen=3)
        paper.identify()
        return paper

    return made


def checked(paper, size_deg):
    """A check that names the drifting joint, as the command writes it."""
    shots = paper.plan(1, 0)
    series = paper.measure("check", shots)
    part = PartChange("joint", DRIFTING, "arm 2's encoder", size_deg, 0.004, "deg", 0.0, 9.0, True)
    found = CalibrationCheck(
        decision="fail", says=f"not good: {part.says}", changed=(part,), parts=(part,),
        shots=4, chi2=99.0, dof=6, p=0.0, misfit_mm=0.1, expected_mm=0.01,
    )  # fmt: skip
    with paper.journal() as journal:
        last = journal.records_of(Finding)[-1].record.body["parameters"]
        flat = {name: each["value"] for name, each in last.items()}
        of = with_values(paper_campaign.NOMINAL.robot, flat).parameters.digest()
        body = TypeAdapter(CalibrationCheck).dump_python(found, mode="json")
        journal.append(Finding("check", body | {"series": series, "of": of, "at_utc": ""}))


@pytest.mark.slow
def test_what_drifts_over_three_campaigns_is_named_with_the_next_check(pkmcal, at, tmp_path):
    folders = [at(month, (month - 3) * 0.01).folder for month in (7, 3, 5)]
    table, picture = tmp_path / "all.csv", tmp_path / "all.svg"
    told = pkmcal("history", *folders, "--json", "--csv", table, "--plot", picture)
    assert told.code == 0, told.err
    found = told.document
    measured = [each["measured_utc"][:7] for each in found["epochs"]]
    assert measured == ["2026-03", "2026-05", "2026-07"], "in the order of time"
    assert found["next_check"]["drifting"] == [DRIFTING]
    drift = found["parameters"][DRIFTING]
    assert drift["line"]["rate"] == pytest.approx(0.04 / 122.0, abs=3.0 * drift["line"]["rate_std"])
    assert drift["changes"][2]["delta"] == pytest.approx(0.04, abs=0.015)
    rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    assert {row["parameter"] for row in rows} == {*found["parameters"]}
    assert DRIFTING in picture.read_text(encoding="utf-8")
    shown = pkmcal("history", *folders).out
    assert "Parameters that changed" in shown
    assert f"{DRIFTING} drifts by +0.0" in shown


def sees_nests(paper, names, shift_mm):
    """The same identification, beside nests that moved by so much in its base frame."""
    places = np.array([[900.0, 800.0, -900.0], [-700.0, 900.0, -950.0], [200.0, -900.0, -300.0]])
    nests = [dict(zip(("x_mm", "y_mm", "z_mm"), each, strict=True)) for each in places + shift_mm]
    known = {name: each | {"std_mm": 0.02} for name, each in zip(names, nests, strict=True)}
    with paper.journal() as journal:
        body = dict(journal.records_of(Finding)[-1].record.body)
        covariance = (1e-4 * np.eye(9)).tolist()
        more = {"nests": known, "nest_covariance_mm2": covariance}
        journal.append(Finding("identification", body | more))


@pytest.mark.long
def test_a_base_that_moved_between_campaigns_is_told_from_a_robot_that_changed(pkmcal, at):
    first, moved, changed, other = (
        at(month, later) for month, later in ((3, 0), (5, 0), (7, 0.3), (9, 0))
    )
    for paper, names, by_mm in (
        (first, "ABC", 0.0), (moved, "ABC", -0.3), (changed, "ABC", -0.3), (other, "ABX", 0.0)
    ):  # fmt: skip
        sees_nests(paper, names, np.array([by_mm, 0.0, 0.0]))
    folders = [each.folder for each in (changed, other, first, moved)]
    before, since = pkmcal("history", *folders, "--json").document["bases"]
    assert (before["since"], before["folder"]) == (str(first.folder), str(moved.folder))
    assert before["base"]["decision"] == "fail"
    assert before["base"]["shift_mm"] == pytest.approx([0.3, 0.0, 0.0], abs=1e-6)
    assert before["base"]["moved_u_mm"] == pytest.approx(2.0 * (2e-4 / 3.0) ** 0.5, rel=0.5)
    assert before["robot_p"] > 0.001
    assert "the base moved 0.300 ± 0.0" in before["says"]
    assert before["says"].endswith("the robot did not change beyond chance")
    assert since["base"]["decision"] == "pass"
    assert since["robot_p"] < 0.001
    assert since["says"].endswith("the robot changed")
    assert f"{moved.folder} since {first.folder}: the base moved" in pkmcal(
        "history", *folders
    ).out.replace("\n", "")


@pytest.mark.slow
def test_checks_and_repairs_count_beside_campaigns(pkmcal, at):
    paper = at(3)
    paper.clock = paper_campaign.Clock(datetime(2026, 4, 2, tzinfo=UTC))
    checked(paper, 0.02)
    found = pkmcal("history", paper.folder, "--json").document
    assert [each["kind"] for each in found["epochs"]] == ["campaign", "check"]
    assert found["epochs"][1]["says"].startswith("not good: arm 2's encoder by +0.0200°")
    assert found["parameters"][DRIFTING]["changes"][1]["delta"] == pytest.approx(0.02)
    assert found["next_check"]["says"].startswith("no trend can be told of 1 campaign and 1 check")
    with paper.journal() as journal:
        body = dict(journal.records_of(Finding)[0].record.body)
        pedigree = {"repairs": "", "changed": ["arm 2's encoder"], "series": [2, 3], "shots": 4}
        body["pedigree"] = pedigree | {"chi2": 1.0, "dof": 1, "p": 0.5}
        body["pedigree"]["position_std_before_mm"] = None
        body["at_utc"] = "2026-04-03T00:00:00+00:00"
        journal.append(Finding("identification", body))
    found = pkmcal("history", paper.folder, "--json").document
    assert [each["kind"] for each in found["epochs"]] == ["campaign", "check", "repair"]
    assert found["epochs"][1]["values"] == {}, "its shots are in the repair"


@pytest.mark.slow
def test_campaigns_of_different_robots_are_refused(pkmcal, at, monkeypatch):
    first = at(3)
    monkeypatch.setattr(
        paper_campaign, "CONTROLLER", replace(paper_campaign.CONTROLLER, serial="R-2")
    )
    other = at(4)
    refused = pkmcal("history", first.folder, other.folder)
    assert refused.code == 2
    assert "is of another robot" in refused.error_line
    assert "'R-2', not 'R-1'" in refused.error_line
    assert "named twice" in pkmcal("history", other.folder, other.folder).error_line


def test_a_folder_without_identification_is_named(pkmcal, tmp_path):
    paper = paper_campaign.new_campaign(tmp_path / "empty")
    paper.run(pairs=2, unseen=1)
    refused = pkmcal("history", paper.folder)
    assert refused.code == 2
    assert "empty: nothing has been identified yet" in refused.error_line
