"""`pkmcal status`: where a campaign is, who works on it, what is next."""

import json
import os

import pytest
from paper_campaign import new_campaign

from app import remembered
from app.console import Terminal
from app.next import tell_next
from campaigns import evidence
from campaigns.campaign import now_utc, open_campaign
from campaigns.campaign_state import state_of
from campaigns.evidence import evaluate
from campaigns.files import memory
from campaigns.files.lock import HOLDER_FILE, campaign_lock
from campaigns.journal.records import Event
from campaigns.next_step import CampaignState, next_step
from campaigns.shots.shot_sets import ShotSet
from campaigns.workflow import status as judging
from campaigns.workflow.status import phase


def status(pkmcal, folder, *words):
    code, out, _ = pkmcal("status", folder, "--json", *words)
    assert code == 0
    return json.loads(out)


@pytest.mark.parametrize(
    ("state", "words"),
    [
        (CampaignState(), "set up"),
        (CampaignState(planned=True), "planned"),
        (CampaignState(planned=True, before=True), "validated before calibration"),
        (CampaignState(measured="run", left="run"), "measured in part, not identified"),
        (CampaignState(measured="import"), "imported, not identified"),
        (CampaignState(measured="run", verdict="not decided"), "identified"),
        (CampaignState(measured="run", verdict="pass"), "identified"),
        (
            CampaignState(measured="run", verdict="pass", holds="identified"),
            "calibrated, not validated",
        ),
        (
            CampaignState(measured="run", verdict="pass", after="pass"),
            "validated after calibration",
        ),
        (
            CampaignState(measured="run", verdict="pass", after="pass", reported=True),
            "validated and reported",
        ),
    ],
)
def test_what_was_reached_has_words(state, words):
    assert phase(state) == words


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
    assert told["next"] == next_step(state_of(evaluate(paper.campaign))).text
    assert (told["decision"], told["doubtful"]) == (None, [])


def test_somebody_who_measures_is_named_and_a_dead_one_is_not(pkmcal, tmp_path):
    paper = new_campaign(tmp_path / "c")
    with campaign_lock(paper.folder, now_utc=now_utc):
        held_by = status(pkmcal, paper.folder)["measuring"]
        _, _, err = pkmcal("report", paper.folder)
        note = json.loads((paper.folder / HOLDER_FILE).read_text())
    assert held_by["pid"] == os.getpid()
    assert f"process {os.getpid()}" in err
    for dead in ({"since_utc": "2001-01-01T00:00:00+00:00"}, {"pid": 2**40}, {"pid": "x"}):
        (paper.folder / HOLDER_FILE).write_text(json.dumps(note | dead))
        assert status(pkmcal, paper.folder)["measuring"] is None


def test_the_present_folder_is_the_campaign_unless_another_is_named(pkmcal, tmp_path, monkeypatch):
    paper = new_campaign(tmp_path / "c")
    monkeypatch.chdir(paper.folder)
    code, out, _ = pkmcal("status", "--json")
    assert (code, json.loads(out)["name"]) == (0, paper.campaign.config.name)


@pytest.mark.parametrize("words", [(), ("shots.csv",)])
def test_a_single_argument_of_import_is_the_file(pkmcal, tmp_path, monkeypatch, words):
    monkeypatch.chdir(new_campaign(tmp_path / "c").folder)
    code, _, err = pkmcal("import", *words)
    assert code == 2
    assert ("FILE is missing", "shots.csv: there is no such file")[len(words)] in err


@pytest.fixture
def judged(monkeypatch, tmp_path):
    """Folders that were judged, while answers are remembered."""
    found, campaign_status = [], judging.campaign_status

    def counted(campaign):
        found.append(campaign.folder)
        return campaign_status(campaign)

    monkeypatch.setattr(judging, "campaign_status", counted)
    monkeypatch.setenv("PKMCAL_CACHE", str(tmp_path / "cache"))
    return found


def kept_answer(folder):
    return memory.recall("status", folder, remembered.digests(folder))


def test_the_same_files_are_judged_once_and_who_measures_is_looked_for_each_time(
    pkmcal, tmp_path, judged
):
    paper = new_campaign(tmp_path / "c")
    lines, told = pkmcal("status", paper.folder), status(pkmcal, paper.folder)
    assert pkmcal("status", paper.folder) == lines
    assert status(pkmcal, paper.folder) == told
    with campaign_lock(paper.folder, now_utc=now_utc):
        assert status(pkmcal, paper.folder)["measuring"]["pid"] == os.getpid()
        assert f"now: process {os.getpid()}" in pkmcal("status", paper.folder)[1]
    assert len(judged) == 1


def test_the_step_after_devices_is_named_again_until_a_file_changes(tmp_path, monkeypatch, capsys):
    paper, judged = new_campaign(tmp_path / "c"), []
    paper.run(pairs=3, unseen=1)
    monkeypatch.setenv("PKMCAL_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(evidence, "evaluate", lambda each: judged.append(each) or evaluate(each))

    def told(**known):
        document = tell_next(Terminal(as_json=True), open_campaign(paper.folder), **known)
        return document, capsys.readouterr().err

    first = told(answered=True)
    assert f"next: {first[0]['next']}" in " ".join(first[1].split())
    assert told(answered=True) == first
    assert len(judged) == 1
    told()
    changed_setting(paper.folder)
    told(answered=True)
    assert len(judged) == 3


def changed_setting(folder):
    file = folder / "campaign.yaml"
    file.write_text(f"{file.read_text()}# a further line\n")


def grown_journal(folder):
    with open_campaign(folder).journal() as journal:
        journal.append(Event("operator note", "moved"))


@pytest.mark.parametrize(
    "change",
    [
        changed_setting,
        grown_journal,
        lambda folder: (folder / "report.html").write_text("<html>"),
        lambda folder: (folder / "plan.csv").write_text("shot"),
        lambda folder: (folder / "robot.yaml").write_text("# another robot"),
        lambda folder: (folder / "campaign.db").write_bytes(b"no journal"),
    ],
)
def test_nothing_is_remembered_of_other_files(pkmcal, tmp_path, judged, change):
    paper = new_campaign(tmp_path / "c")
    paper.run(pairs=3, unseen=1)
    told = [pkmcal("status", paper.folder) for _ in range(2)]
    assert told[0] == told[1]
    assert len(judged) == 1
    change(paper.folder)
    assert not kept_answer(paper.folder)


def test_nothing_is_remembered_of_other_software(pkmcal, tmp_path, judged, monkeypatch):
    paper = new_campaign(tmp_path / "c")
    told = status(pkmcal, paper.folder)
    monkeypatch.setattr(memory, "VERSION", "0.0.9")
    assert status(pkmcal, paper.folder) == told
    assert len(judged) == 2


def test_an_answer_is_not_kept_for_files_that_changed_meanwhile(pkmcal, tmp_path, monkeypatch):
    paper = new_campaign(tmp_path / "c")
    monkeypatch.setenv("PKMCAL_CACHE", str(tmp_path / "cache"))
    campaign_status = judging.campaign_status

    def disturbed(campaign):
        found = campaign_status(campaign)
        grown_journal(paper.folder)
        return found

    monkeypatch.setattr(judging, "campaign_status", disturbed)
    status(pkmcal, paper.folder)
    assert not kept_answer(paper.folder)


@pytest.mark.parametrize("kept", [b"", b"[]", b'{"of": 1}', b"\xff"])
def test_what_cannot_be_read_among_the_caches_is_not_remembered(pkmcal, tmp_path, judged, kept):
    paper = new_campaign(tmp_path / "c")
    told = status(pkmcal, paper.folder)
    (file,) = (tmp_path / "cache").rglob("*.json")
    file.write_bytes(kept)
    assert status(pkmcal, paper.folder) == told
    assert len(judged) == 2
