"""`pkmcal history`: one robot over campaigns and checks, on the terminal and in files."""

import csv
from dataclasses import asdict, replace
from datetime import UTC, datetime

import numpy as np
import paper_campaign
import pytest
from par4_space import par4, with_values

from campaigns.identification.checking import RecordedCheck
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


def checked(paper):
    """A check that names the drifting joint, as the command writes it."""
    shots = paper.plan(1, 0)
    series = paper.measure("check", shots)
    with paper.journal() as journal:
        last = journal.records_of(Finding)[-1].record.body["parameters"]
        flat = {name: each["value"] for name, each in last.items()}
        of = with_values(paper_campaign.NOMINAL.robot, flat).parameters.digest()
        found = RecordedCheck(
            decision="fail", says="the robot has changed: encoder 2", shots=4, chi2=99.0, dof=6,
            p=0.0, parts=("encoder 2",), log_factors={}, series=series, of=of, at_utc="",
        )  # fmt: skip
        journal.append(Finding("check", asdict(found)))


@pytest.mark.slow
def test_parameters_of_three_campaigns_stand_in_a_table_by_date(pkmcal, at, tmp_path):
    folders = [at(month, (month - 3) * 0.01).folder for month in (7, 3, 5)]
    table = tmp_path / "all.csv"
    told = pkmcal("history", *folders, "--json", "--csv", table)
    assert told.code == 0, told.err
    epochs = told.document["epochs"]
    measured = [each["measured_utc"][:7] for each in epochs]
    assert measured == ["2026-03", "2026-05", "2026-07"], "in the order of time"
    errors = [[e for e in each["parameters"] if e["name"] == DRIFTING] for each in epochs]
    deltas, std = ([error[of] for (error,) in errors] for of in ("delta", "std"))
    true_deg = paper_campaign.ERRORS[DRIFTING]
    for delta, later_deg in zip(deltas, (0.0, 0.02, 0.04), strict=True):
        assert delta == pytest.approx(true_deg + later_deg, abs=4.0 * max(std))
    rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    own = [row for row in rows if row["parameter"] == DRIFTING]
    assert [float(row["Δ"]) for row in own] == pytest.approx(deltas, abs=1e-4)
    assert len(rows) == 3 * len(epochs[0]["parameters"])
    shown = pkmcal("history", *folders).out
    assert "identified minus nominal" in shown
    assert shown.count(DRIFTING) == 3


@pytest.mark.slow
def test_checks_stand_beside_campaigns(pkmcal, at):
    paper = at(3)
    paper.clock = paper_campaign.Clock(datetime(2026, 4, 2, tzinfo=UTC))
    checked(paper)
    campaign, check = pkmcal("history", paper.folder, "--json").document["epochs"]
    assert (campaign["kind"], check["kind"]) == ("campaign", "check")
    assert (check["decision"], check["parameters"]) == ("fail", [])
    assert "2: the robot has changed: encoder 2" in pkmcal("history", paper.folder).out


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
