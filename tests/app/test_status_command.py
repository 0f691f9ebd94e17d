"""`pkmcal status`: where a campaign is, who works on it, what is next."""

import json
import os

import pytest
from paper_campaign import MECHANISM, new_campaign

from campaigns.assessment import evaluate
from campaigns.campaign import now_utc
from campaigns.files.lock import LOCK_FILE, campaign_lock
from campaigns.next_step import next_step, state_of
from campaigns.planning.plan_file import write_plan
from campaigns.shots.shot_sets import ShotSet
from drivers.texts import moment


def status(pkmcal, folder, *words):
    code, out, _ = pkmcal("status", folder, "--json", *words)
    assert code == 0
    return json.loads(out)


def test_what_was_begun_and_not_ended_is_open_and_the_next_command_is_that_of_all(pkmcal, tmp_path):
    paper = new_campaign(tmp_path / "c")
    paper.validate("before", frozenset({ShotSet.ROTATION}))
    paper.run(pairs=3, unseen=1)
    paper.measure("after", paper.plan(1, 0), finished=False)
    told = status(pkmcal, paper.folder)
    assert told["phase"] == "measured, not identified"
    assert [(each["stage"], each["finished"]) for each in told["series"]] == [
        ("before", True),
        ("run", True),
        ("after", False),
    ]
    assert (told["series"][1]["shots"], told["series"][1]["planned"]) == (10, 10)
    assert [text.split(",")[0] for text in told["open"]] == ["series 3"]
    with paper.journal() as journal:
        assert (told["records"], told["digest"]) == (journal.last_number(), journal.digest())
    assert told["next"] == next_step(state_of(evaluate(paper.campaign))).text
    assert (told["decision"], told["doubtful"]) == (None, [])


def test_somebody_who_measures_is_named_and_a_dead_one_is_not(pkmcal, tmp_path):
    paper = new_campaign(tmp_path / "c")
    with campaign_lock(paper.folder, now_utc=now_utc):
        told = status(pkmcal, paper.folder)
        _, _, err = pkmcal("report", paper.folder)
        note = (paper.folder / LOCK_FILE).read_text()
    assert told["measuring"]["pid"] == os.getpid()
    assert told["next"] == f"pkmcal status {paper.folder}", "there is nothing to do but wait"
    assert f"process {os.getpid()}" in err
    (paper.folder / LOCK_FILE).write_text(note)  # as a killed process leaves it
    assert status(pkmcal, paper.folder)["measuring"] is None


def test_the_present_folder_is_the_campaign_unless_another_is_named(pkmcal, tmp_path, monkeypatch):
    paper = new_campaign(tmp_path / "c")
    monkeypatch.chdir(paper.folder)
    code, out, _ = pkmcal("status", "--json")
    assert (code, json.loads(out)["name"]) == (0, paper.campaign.config.name)


def test_a_validation_under_way_is_said_to_be_so_with_shots_and_end(pkmcal, tmp_path):
    """Neither validated, nor without a number of shots: it is measured now."""
    paper = new_campaign(tmp_path / "c")
    write_plan(paper.campaign.plan_path, paper.plan(3, 0), MECHANISM)
    paper.measure("before", paper.plan(3, 0), finished=False, stopped=False, planned=20)
    with campaign_lock(paper.folder, now_utc=now_utc):
        answer = status(pkmcal, paper.folder)
        _, out, _ = pkmcal("status", paper.folder)
    assert answer["phase"].startswith("validating before calibration, 8 of 20 shots, ends ")
    assert (answer["series"][-1]["planned"], len(answer["series"][-1]["ends_utc"])) == (20, 2)
    assert out.count("series 1, before: 8 of 20 shots, not finished") == 1
    assert moment(answer["measuring"]["since_utc"]) in out, "times are local"
    # nothing works on it any more: the validation is still to be ended
    answer = status(pkmcal, paper.folder)
    assert answer["phase"] == "planned"
    assert answer["next"].endswith("--stage before")


@pytest.mark.slow
def test_a_validation_after_that_broke_off_shows_nothing_yet(pkmcal, loaded, tmp_path):
    paper = loaded.copy_to(tmp_path / "c")
    held = status(pkmcal, paper.folder)["phase"]
    assert held == "calibrated, not validated"
    paper.measure("after", paper.plan(3, 0), finished=False, planned=20)
    assert status(pkmcal, paper.folder)["phase"] == held
    paper.measure("after", paper.plan(3, 0))
    assert status(pkmcal, paper.folder)["phase"] == "validated after calibration"
