"""Only what this journal identified last is loaded: any other file is refused before a byte."""

import re
import shutil

import pytest
from command_line import change

from campaigns.journal.journal import read_journal
from campaigns.journal.records import Finding
from sim.in_process import MemoryPipe

OTHER = "a" * 32


@pytest.fixture
def sent(monkeypatch):
    """Every byte that goes to a simulated device."""
    sent, send = [], MemoryPipe.send

    def recorded(pipe, data, timeout_s):
        sent.append(data)
        send(pipe, data, timeout_s)

    monkeypatch.setattr(MemoryPipe, "send", recorded)
    return sent


def state(folder, key, value):
    """Write another value of a line of the exported file; its numbers stay to the last digit."""
    file = folder / "robot-compensated.yaml"
    text, changes = re.subn(
        rf"(?m)^  {key}: .*\n", value and f"  {key}: {value}\n", file.read_text()
    )
    assert changes == 1
    file.write_text(text)


def of_another_campaign(pkmcal, folder):
    """The file comes from a copy of the folder that is a campaign of its own, of the same name."""
    state(folder, "identity", OTHER)


def in_a_folder_without_a_journal(pkmcal, folder):
    for file in folder.glob("campaign.db*"):
        file.unlink()
    change(folder / "campaign.yaml", {"identity": OTHER})


def of_an_earlier_identification(pkmcal, folder):
    assert pkmcal("identify", folder, "--fix", "rods").code in {0, 1}


def with_another_digit(pkmcal, folder):
    file = folder / "robot-compensated.yaml"
    file.write_text(re.sub("arm_mm: 3", "arm_mm: 4", file.read_text(), count=1))


def of_a_campaign_of_another_name(pkmcal, folder):
    state(folder, "campaign", "press 4")


def of_another_record(pkmcal, folder):
    state(folder, "identification_digest", f"'{'0' * 64}'")


def of_an_older_version(pkmcal, folder):
    state(folder, "identification_record", "")


@pytest.mark.parametrize(
    ("make", "reason", "name"),
    [
        (of_another_campaign, f"of another campaign of this name, of identity {OTHER}", "identity"),
        (in_a_folder_without_a_journal, "of another campaign of this name", "identity"),
        (of_an_earlier_identification, "it is of an earlier identification", "superseded"),
        (with_another_digit, "somebody changed the geometry", None),
        (of_a_campaign_of_another_name, "it is of the campaign 'press 4'", "identity"),
        (of_another_record, "is not in this journal", "identity"),
        (of_an_older_version, "does not say which record of the journal", "origin"),
    ],
)
def test_a_foreign_file_is_refused_before_a_byte_is_sent(
    pkmcal, exported, sent, make, reason, name
):
    make(pkmcal, exported)
    sent.clear()
    refused = pkmcal("load", exported, "--yes")
    assert refused.code == 2
    assert reason in refused.error_line
    assert sent == []
    assert not list(exported.glob("controller-before-*"))
    assert (f"--force {name}" in refused.error_line) == (name is not None)


def test_each_objection_is_overruled_by_its_name_alone_and_recorded(pkmcal, exported, sent):
    of_an_earlier_identification(pkmcal, exported)
    state(exported, "verdict", "fail")
    sent.clear()
    refused = pkmcal("load", exported, "--yes", "--force", "superseded")
    assert (refused.code, sent) == (2, [])
    assert "`--force verdict` loads it all the same" in refused.error_line
    loaded = pkmcal("load", exported, "--yes", "--force", "superseded", "--force", "verdict")
    assert loaded.code == 0
    with read_journal(exported / "campaign.db") as journal:
        body = [entry.record.body for entry in journal.records_of(Finding)][-1]
    assert [text.partition(":")[0] for text in body["forced"]] == ["superseded", "verdict"]


@pytest.mark.parametrize("words", [("--force",), ("--force", "--yes")])
def test_force_without_a_name_is_refused_with_the_names(pkmcal, exported, sent, words):
    refused = pkmcal("load", exported, *words)
    assert (refused.code, sent) == (2, [])
    assert "serial" in refused.error_line
    assert "far-from-nominal" in refused.error_line


def test_the_nominal_set_needs_no_journal(pkmcal, exported):
    assert pkmcal("load", exported, "--yes").code == 0
    for file in exported.glob("campaign.db*"):
        file.unlink()
    nominal = ("load", exported, "--robot", exported / "robot.yaml", "--yes")
    assert "loaded and verified" in pkmcal(*nominal).out


def test_a_file_in_the_backups_place_is_not_put_back(pkmcal, exported, sent):
    assert pkmcal("load", exported, "--yes").code == 0
    backup = exported / "controller-before-1.yaml"
    shutil.copy(exported / "robot-compensated.yaml", backup)
    refused = pkmcal("load", exported, "--rollback", "--yes")
    assert refused.code == 2
    assert "does not hold what the journal says the load replaced" in refused.error_line
    assert not any(b"STAGE" in data for data in sent[-10:])


def test_the_memory_of_another_campaigns_cell_is_refused(pkmcal, exported, sent):
    memory = exported / "cell-memory.json"
    memory.write_text(re.sub(r'"identity": "\w+"', f'"identity": "{OTHER}"', memory.read_text()))
    refused = pkmcal("load", exported, "--dry")
    assert (refused.code, sent) == (2, [])
    assert "is of another campaign's cell" in refused.error_line
    memory.unlink()
    assert pkmcal("load", exported, "--dry").code == 0
