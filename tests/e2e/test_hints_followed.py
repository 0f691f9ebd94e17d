"""A hint ends the complaint: who does what an error says does not get the same line again."""

import re
import shlex
import shutil
import sqlite3
from contextlib import closing

import pytest
from command_line import change

MOVES = {"run", "validate", "load", "check"}
"""Commands that ask whether the cell is clear: it is."""
DEEPEST = 12
"""Hints in a row, from nothing measured to a loaded controller."""


def obey(pkmcal, words, deeper=DEEPEST, before=()):
    """Give a command and do as its errors say, until it ends well; no line may come back."""
    yes = ["--yes"] if words[0] in MOVES and "--yes" not in words else []
    ended = pkmcal(*words, *yes)
    if ended.code in {0, 1}:
        return ended
    line = ended.error_line
    assert line not in before, f"came back: {line}"
    assert deeper, f"no end: {line}"
    if not by_hand(line):
        named = [text for text in re.findall("`pkmcal ([^`]+)`", line) if "FILE" not in text]
        assert named, f"names nothing to type: {line}"
        # What a hint names may complain itself, and is obeyed, too; of a damaged journal it says
        # where the copy is.
        obey(pkmcal, shlex.split(named[0]), deeper - 1, (*before, line))
    return obey(pkmcal, words, deeper - 1, (*before, line))


def by_hand(line):
    """Do what no command does, if the line says so."""
    if copy := re.search(r"rename (\S+) to campaign\.db", line):
        place = re.search(r"(/\S+)/campaign", line)[1]
        shutil.move(f"{place}/{copy[1]}", f"{place}/campaign.db")
        return True
    return False


@pytest.mark.parametrize("command", ["history", "load", "check-journal"])
def test_a_command_is_reached_from_an_empty_campaign_by_its_hints(pkmcal, planned, command):
    (planned / "plan.csv").unlink()
    assert obey(pkmcal, [command, str(planned)]).code in {0, 1}


DAMAGES = {
    "no rules": ("DROP TRIGGER a_record_is_never_changed",),
    "a record is missing": (
        "DROP TRIGGER a_record_is_never_removed",
        "DELETE FROM record WHERE id = (SELECT max(id) FROM record)",
    ),
    "no stated end": ("DROP TABLE chain_end",),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
@pytest.mark.parametrize("command", ["check-journal", "run"])
def test_a_damaged_journal_is_whole_again_by_what_its_error_says(pkmcal, measured, damage, command):
    with closing(sqlite3.connect(measured / "campaign.db", isolation_level=None)) as other:
        for statement in damage:
            other.execute(statement)
    assert pkmcal(command, measured).code == 4
    assert obey(pkmcal, [command, str(measured)]).code == 0
    assert pkmcal("check-journal", measured).code == 0


def next_of(ended):
    (line,) = [line for line in ended.err.splitlines() if line.startswith("next: pkmcal ")]
    return shlex.split(line.removeprefix("next: pkmcal "))


def test_a_folder_whose_name_begins_with_a_dash_can_be_typed(pkmcal, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = pkmcal("new", "./-cell7", "--scenario", "paper-simulation")
    assert made.code == 0
    change(tmp_path / "-cell7" / "campaign.yaml", {"plan.shots": 8, "plan.validation_pairs": 0})
    assert pkmcal(*next_of(made)).code == 0


def test_an_older_memory_of_the_cell_is_called_that_and_names_what_to_delete(pkmcal, planned):
    memory = planned / "cell-memory.json"
    memory.write_text('{"schema": "pkmcal/cell-memory/1", "scenario": "paper-simulation"}')
    refused = pkmcal("devices", planned)
    assert "of another version, or damaged: seed: field required" in refused.error_line
    assert "http" not in refused.error_line
    assert "delete the simulated cell's memory, cell-memory.json" in refused.error_line
    memory.unlink()
    assert pkmcal("devices", planned).code == 0
