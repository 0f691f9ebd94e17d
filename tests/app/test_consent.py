"""Commands that a campaign's files name run only after this user has once agreed."""

import pytest
from command_line import Keyboard, change

from app.consent import consent_note, require_consent
from app.exits import NotConfirmed
from app.main import run_command
from campaigns.errors import ConfigInvalid

SSH = "ssh operator@controller"
PROGRAM = '#!/bin/sh\ntouch "$0-ran"\n'


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch):
    """The user's state directory."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state"


@pytest.fixture
def asked(monkeypatch, capsys):
    """Asks for a consent on a terminal where this is answered; gives the question, if any."""

    def ask(file, answer, command=SSH):
        monkeypatch.setattr("sys.stdin", Keyboard(answer))
        capsys.readouterr()
        require_consent(file, command)
        return capsys.readouterr().err

    return ask


@pytest.fixture
def file(tmp_path):
    (tmp_path / "campaign").mkdir()
    (tmp_path / "campaign" / "cell.yaml").write_text("one")
    return tmp_path / "campaign" / "cell.yaml"


def test_a_command_is_shown_and_asked_about_once(file, asked, state):
    assert f"{file} lets '{SSH}' run on this computer" in asked(file, "y\n")
    assert asked(file, "") == ""
    assert [note.read_text() for note in state.rglob("*") if note.is_file()] == [f"{file}\n{SSH}\n"]


def test_no_leaves_no_consent(file, asked, state):
    for _ in range(2):
        with pytest.raises(NotConfirmed, match="--yes is no consent"):
            asked(file, "n\n")
    assert not state.exists()


def test_a_changed_file_another_folder_or_command_is_asked_about_anew(file, asked):
    asked(file, "y\n")
    with pytest.raises(NotConfirmed):
        asked(file, "", "ssh elsewhere")
    other = file.parent.rename(file.parent.with_name("moved")) / "cell.yaml"
    with pytest.raises(NotConfirmed):
        asked(other, "")
    moved_back = other.parent.rename(file.parent) / "cell.yaml"
    assert asked(moved_back, "") == ""
    file.write_text("two")
    with pytest.raises(NotConfirmed):
        asked(file, "")


def test_a_program_in_the_files_own_folder_is_never_run(file, asked):
    for program in (file.with_name("beside"), f"{file.parent}/../campaign/x/beside"):
        with pytest.raises(NotConfirmed, match="is in the folder of the file"):
            asked(file, "y\n", str(program))


def test_a_state_directory_is_not_looked_for_where_one_happens_to_be(file, asked, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", "state")
    monkeypatch.setenv("HOME", str(file.parents[1] / "home"))
    monkeypatch.chdir(file.parent)
    assert consent_note(file, SSH).is_relative_to(file.parents[1] / "home" / ".local" / "state")


def test_a_file_that_is_gone_is_told(file):
    with pytest.raises(ConfigInvalid, match="no such file"):
        consent_note(file.with_name("other.yaml"), SSH)


@pytest.fixture
def beside(tmp_path):
    """A program of somebody's that leaves a trace."""
    program = tmp_path / "beside"
    program.write_text(PROGRAM)
    program.chmod(0o755)
    return program


@pytest.fixture
def folder(tmp_path):
    assert run_command(["new", str(tmp_path / "mine"), "--scenario", "paper-simulation"]) == 0
    return tmp_path / "mine"


@pytest.mark.parametrize(
    "words", ["devices DIR", "validate DIR --stage before --yes", "sim DIR/cell.yaml"]
)
def test_no_command_runs_a_cell_files_program_unasked(folder, beside, words, capsys):
    with (folder / "cell.yaml").open("a") as cell:
        cell.write(f'controller:\n  joints_from: "hal:{beside}"\n')
    assert run_command(words.replace("DIR", str(folder)).split()) == 2
    assert f"nobody has agreed that '{beside}' is run" in capsys.readouterr().err
    assert not beside.with_name("beside-ran").exists()


def test_the_command_beside_linuxcnc_is_asked_about_too(folder, beside, capsys):
    linuxcnc = {"hal_file": "calib.hal", "beside": str(beside)}
    controller = {"controller.driver": "linuxcnc", "controller.linuxcnc": linuxcnc}
    change(folder / "campaign.yaml", controller)
    assert run_command(["devices", str(folder)]) == 2
    assert f"nobody has agreed that '{beside}' is run" in capsys.readouterr().err


def test_a_command_line_in_a_cell_file_is_not_even_asked_about(folder, capsys):
    with (folder / "cell.yaml").open("a") as cell:
        cell.write("controller:\n  joints_from: \"hal:sh -c 'true'\"\n")
    assert run_command(["devices", str(folder)]) == 2
    assert "the command 'sh -c 'true'' is none of those" in capsys.readouterr().err
