"""`pkmcal history`: one robot over campaigns and checks, on the terminal and in files."""

import csv
from dataclasses import asdict, replace
from datetime import UTC, datetime
from unittest.mock import patch

import numpy as np
import paper_campaign
import pytest
from par4_space import par4, with_values

from campaigns.controllers.export import latest_identification
from campaigns.identification.checking import RecordedCheck
from campaigns.journal.records import Finding

DRIFTING = "arm2.joint_offset_deg"


def identified_in(folder, month, later_deg=0.0, model="full"):
    """Return a campaign of a month, in which the offset of one joint was so much larger."""
    nominal, errors = paper_campaign.NOMINAL.robot.parameters, dict(paper_campaign.ERRORS)
    errors[DRIFTING] += later_deg
    true = par4(nominal | {name: nominal[name] + error for name, error in errors.items()})
    with patch.object(paper_campaign, "TRUE", true):
        paper = paper_campaign.new_campaign(folder)
        paper.rng = np.random.default_rng(month)
        paper.clock = paper_campaign.Clock(datetime(2026, month, 2, tzinfo=UTC))
        paper.run()
        paper.identify(model)
    return paper


@pytest.fixture(scope="module")
def march(tmp_path_factory):
    """The first campaign; leave it as it is."""
    return identified_in(tmp_path_factory.mktemp("history") / "m3", 3)


def append_check(paper):
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
def test_parameters_of_campaigns_stand_in_a_table_by_date(pkmcal, march, tmp_path):
    folders = [identified_in(tmp_path / "m7", 7, 0.04).folder, march.folder]
    table = tmp_path / "all.csv"
    told = pkmcal("history", *folders, "--json", "--csv", table)
    assert told.code == 0, told.err
    epochs = told.document["epochs"]
    measured = [each["measured_utc"][:7] for each in epochs]
    assert measured == ["2026-03", "2026-07"], "in the order of time"
    errors = [[e for e in each["parameters"] if e["name"] == DRIFTING] for each in epochs]
    deltas, std = ([error[of] for (error,) in errors] for of in ("delta", "std"))
    true_deg = paper_campaign.ERRORS[DRIFTING]
    for delta, later_deg in zip(deltas, (0.0, 0.04), strict=True):
        assert delta == pytest.approx(true_deg + later_deg, abs=4.0 * max(std))
    rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    (own,) = [row for row in rows if row["parameter"] == DRIFTING]
    titles = [f"{march.folder} 2026-03-02", f"{folders[0]} 2026-07-02"]
    assert [float(own[f"{title} delta"]) for title in titles] == pytest.approx(deltas, abs=1e-9)
    assert [float(own[f"{title} std"]) for title in titles] == pytest.approx(std, abs=1e-9)
    assert len(rows) == len(epochs[0]["parameters"])
    pkmcal("history", *folders, "--csv", table, "--excel")
    assert table.read_bytes().startswith(b"\xef\xbb\xbfparameter;unit;")
    (drifting,) = [line for line in table.read_text().splitlines() if line.startswith(DRIFTING)]
    shown = [float(cell.replace(",", ".")) for cell in drifting.split(";")[2::2]]
    assert shown == pytest.approx(deltas, abs=1e-9)
    shown = pkmcal("history", *folders).out
    assert "identified minus nominal" in shown
    assert shown.count(DRIFTING) == 2


def test_campaigns_of_different_robots_are_refused(pkmcal, march, tmp_path, monkeypatch):
    other_controller = replace(paper_campaign.CONTROLLER, serial="R-2")
    monkeypatch.setattr(paper_campaign, "CONTROLLER", other_controller)
    other = identified_in(tmp_path / "m4", 4, model="paper")
    refused = pkmcal("history", march.folder, other.folder)
    assert refused.code == 2
    assert "is of another robot" in refused.error_line
    assert "'R-2', not 'R-1'" in refused.error_line
    assert "add --csv FILE" in pkmcal("history", march.folder, "--excel").error_line
    assert "named twice" in pkmcal("history", other.folder, other.folder).error_line
    # a campaign without a serial number first hides no other robot among the later ones
    unnamed = replace(paper_campaign.CONTROLLER, serial="")
    monkeypatch.setattr(paper_campaign, "CONTROLLER", unnamed)
    first = identified_in(tmp_path / "m5", 5, model="paper")
    refused = pkmcal("history", first.folder, march.folder, other.folder)
    assert refused.code == 2
    assert "'R-2', not 'R-1'" in refused.error_line


def test_checks_stand_beside_campaigns(pkmcal, march, tmp_path):
    april = march.copy_to(tmp_path / "m4")
    april.clock = paper_campaign.Clock(datetime(2026, 4, 2, tzinfo=UTC))
    append_check(april)
    campaign, check = pkmcal("history", april.folder, "--json").document["epochs"]
    assert (campaign["kind"], check["kind"]) == ("campaign", "check")
    assert (check["decision"], check["parameters"]) == ("fail", [])
    assert "2: the robot has changed: encoder 2" in pkmcal("history", april.folder).out


def append_finding(paper, kind, body):
    with paper.journal() as journal:
        journal.append(Finding(kind, body))


def by_older_model(paper):
    """The last identification as older versions wrote it: without what they did not compute."""
    with paper.journal() as journal:
        body = latest_identification(journal).document()
    return {key: body[key] for key in body if key not in ("events", "diagnosis")}


@pytest.mark.usefixtures("undrawn")
def test_results_of_an_older_model_are_marked_until_they_are_renewed(pkmcal, march, tmp_path):
    paper = march.copy_to(tmp_path / "m8")
    table = tmp_path / "all.csv"
    assert "older model:" not in pkmcal("history", paper.folder, "--csv", table).out
    assert "(older model)" not in table.read_text(encoding="utf-8")
    append_finding(paper, "identification", by_older_model(paper))
    shown = pkmcal("history", paper.folder, "--csv", table)
    words = "1: by an older model: figures are not comparable; run `pkmcal identify"
    assert f"{words} {paper.folder}` again" in shown.out
    rows = csv.DictReader(table.read_text(encoding="utf-8").splitlines())
    assert all(" (older model) " in head for head in rows.fieldnames[2:])
    (epoch,) = pkmcal("history", paper.folder, "--json").document["epochs"]
    assert epoch["by_older_model"]
    assert epoch["parameters"], "its figures are still shown"
    # a run since then cannot be identified by the command's advice
    series = paper.measure("run", paper.plan(1, 0))
    (older, *_) = pkmcal("history", paper.folder, "--json").document["epochs"]
    assert series == 2
    assert older["note"] == "by an older model: figures are not comparable"
    page = pkmcal("report", paper.folder)
    assert page.code in (0, 1)
    html = (paper.folder / "report.html").read_text(encoding="utf-8")
    assert "Identified by an older model: run" in html
    assert 'id="course"' not in html


def test_the_papers_method_is_no_older_model(pkmcal, tmp_path):
    paper = paper_campaign.new_campaign(tmp_path / "method")
    paper.run()
    paper.identify("paper")
    assert "older model:" not in pkmcal("history", paper.folder).out


def test_findings_in_another_form_are_named_and_left_out(pkmcal, tmp_path):
    paper = paper_campaign.new_campaign(tmp_path / "m9")
    paper.run()
    old = {"schema": "pkmcal/identification/1", "series": 1, "verdict": "pass"}
    append_finding(paper, "identification", old)
    append_finding(paper, "check", {"answer": "as it was"})
    shown = pkmcal("history", paper.folder)
    words = "left out: another version of the software wrote it in another form"
    assert f"1: {words}; run `pkmcal identify" in shown.out
    assert f"2: {words}\n" in shown.out
    epochs = pkmcal("history", paper.folder, "--json").document["epochs"]
    assert [(e["kind"], e["decision"]) for e in epochs] == [("campaign", None), ("check", None)]
    # identified again, the series has a result, and the old one is no longer named
    paper.identify()
    kinds = [e["decision"] for e in pkmcal("history", paper.folder, "--json").document["epochs"]]
    assert sorted(map(str, kinds)) == ["None", "pass"]
