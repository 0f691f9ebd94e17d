"""A hint ends the complaint: who does what an error says does not get the same line again."""

import re
import shlex
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

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
def test_a_command_is_reached_from_an_empty_campaign_by_its_hints(
    pkmcal, planned, measured_once, command
):
    (plan := planned / "plan.csv").unlink()

    def soon(*words):
        """Run a command; what `run` measures of such a plan is there already."""
        if words[0] == "run" and plan.exists():
            assert plan.read_bytes() == (measured_once / "plan.csv").read_bytes()
            shutil.copytree(measured_once, planned, dirs_exist_ok=True)
        return pkmcal(*words)

    assert obey(soon, [command, str(planned)]).code in {0, 1}


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


ODD_NAMES = ("a'b dir", 'x $HOME "q"', "./-dash", "ünï/sub dir")


def hint(ended):
    """Words of what is next; () if nothing is."""
    said = re.search(r"^next: pkmcal (.*)$", ended.out + ended.err, re.M)
    return tuple(shlex.split(said[1])) if said else ()


def follow(pkmcal, folder, most):
    """Type up to `most` times what is next, and no command twice but the report; give the words."""
    typed, ended = [], pkmcal("status", folder)
    assert ended.code == 0
    while (words := hint(ended)) and len(typed) < most:
        if words in typed:  # people decide, and the report is made again
            assert words[0] == "report", typed
            break
        if "move this one away" in ended.out + ended.err:
            Path(folder, "report.html").rename(Path(folder, "somebodys.html"))
        ended = pkmcal(*words, *(["--yes"] if words[0] in MOVES else []))
        assert ended.code in {0, 1}, (words, ended.err)
        typed.append(words)
    return typed


def without_plan(folder):
    (folder / "plan.csv").unlink()


def spoilt_plan(folder):
    (folder / "plan.csv").write_text("shot")


def unsafe_plan(folder):
    """One joint far outside of the robot's limits."""
    head, *rows = (folder / "plan.csv").read_text().splitlines()
    place = head.split(",").index("q0_deg")
    cells = rows[5].split(",")
    cells[place] = "170"
    rows[5] = ",".join(cells)
    (folder / "plan.csv").write_text("\n".join([head, *rows]))


def anothers_files(folder):
    for name in ("robot-compensated.yaml", "robot-plain.yaml", "report.html"):
        (folder / name).write_text("somebody's")


def other_limits(folder):
    change(folder / "campaign.yaml", {"acceptance.distance_mean_mm": 0.01})


DAMAGES_OF_FILES = (without_plan, spoilt_plan, unsafe_plan, anothers_files, other_limits)


def damaged(campaign, damage, parent, monkeypatch):
    """A copy of a campaign, damaged, under an odd name; gives the name from its parent."""
    monkeypatch.chdir(parent)
    name = ODD_NAMES[DAMAGES_OF_FILES.index(damage) % len(ODD_NAMES)]
    damage(Path(shutil.copytree(campaign, parent / name)))
    return name


@pytest.mark.parametrize("damage", DAMAGES_OF_FILES)
def test_what_is_next_after_a_damage_is_not_refused(
    pkmcal, planned_once, measured_once, exported_once, tmp_path, damage, monkeypatch
):
    for stage, campaign in enumerate((planned_once, measured_once, exported_once)):
        if stage == 2 or damage in {spoilt_plan, unsafe_plan}:
            (parent := tmp_path / str(stage)).mkdir()
            assert follow(pkmcal, damaged(campaign, damage, parent, monkeypatch), 1)


@pytest.mark.long
@pytest.mark.parametrize("damage", DAMAGES_OF_FILES)
def test_hints_lead_from_a_damage_to_the_report(
    pkmcal, exported_once, tmp_path, damage, monkeypatch
):
    folder = damaged(exported_once, damage, tmp_path, monkeypatch)
    assert follow(pkmcal, folder, 12)[-1][0] == "report"
