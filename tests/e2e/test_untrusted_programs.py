"""A program that came with a campaign's folder runs only if this user trusts it."""

import os
import shutil
import sys

import pytest
from command_line import Keyboard, change

from app.monitor.live_state import live_state
from campaigns.campaign import open_campaign
from campaigns.errors import ConfigInvalid
from campaigns.robots import program
from campaigns.robots.program import Program, ProgramUntrusted, trust, trusted_programs
from campaigns.robots.robot import read_robot

LEAVES_A_MARK = """
from pathlib import Path

Path(__file__).with_name("mark").touch()

from campaigns.kinematics.catalog import PAR4 as OWN
"""
WAITS = """
import time

while True:
    try:
        time.sleep(9.0)
    except Exception:
        pass
"""
WITHOUT_THE_ROBOT = (("check-journal",), ("status",), ("history",))
WITH_THE_ROBOT = (
    ("plan",), ("run", "--yes"), ("identify",), ("export", "--force"), ("load", "--yes"),
    ("report",), ("check", "--yes"), ("validate", "--stage", "before", "--yes"),
)  # fmt: skip


@pytest.fixture(autouse=True)
def configuration(tmp_path, monkeypatch):
    """A user who trusts nothing yet."""
    folder = tmp_path / "configuration"
    monkeypatch.setenv("XDG_CONFIG_HOME", str(folder))
    return folder


@pytest.fixture
def sent(exported):
    """A folder that somebody sent, with a program of his."""
    (exported / "my.py").write_text(LEAVES_A_MARK, encoding="utf-8")
    for file in ("robot.yaml", "robot-compensated.yaml"):
        text = (exported / file).read_text(encoding="utf-8")
        (exported / file).write_text(text.replace("mechanism: par4", "mechanism: my.py:OWN"))
    return exported


@pytest.mark.parametrize("words", WITHOUT_THE_ROBOT)
def test_what_only_reads_needs_no_program(pkmcal, sent, words):
    ended = pkmcal(words[0], sent, *words[1:])
    assert ended.code == 0
    assert not (sent / "mark").exists()


def test_the_live_page_needs_no_program(sent):
    state = live_state(sent)
    assert (state["done"], state["campaign"]) == (33, "not evaluated")
    assert not (sent / "mark").exists()


def test_status_states_the_journal_and_what_it_left_out(pkmcal, sent):
    status = pkmcal("status", sent, "--json").document
    assert status["series"][0]["shots"] == 33
    assert status["next"].endswith(f"pkmcal trust {sent / 'my.py'}")
    assert "is a program that came with this folder" in " ".join(status["open"])


@pytest.mark.parametrize("words", WITH_THE_ROBOT)
def test_what_needs_the_robot_refuses_its_program_until_it_is_trusted(pkmcal, sent, words):
    ended = pkmcal(words[0], sent, *words[1:])
    assert ended.code == 2
    digest = Program.read(sent / "my.py").sha256
    assert f"{sent / 'my.py'} is a program that came with this folder" in ended.error_line
    assert digest in ended.error_line
    assert "read it, then `pkmcal trust " in ended.error_line
    assert not (sent / "mark").exists()


@pytest.mark.parametrize("command", ["new", "dry-run"])
def test_a_robot_file_that_was_sent_is_refused_in_its_turn(pkmcal, sent, tmp_path, command):
    refused = pkmcal(command, tmp_path / "made", "--robot", sent / "robot.yaml")
    assert refused.code == 2
    assert "is a program" in refused.error_line
    assert not (sent / "mark").exists()


def test_trusted_runs_changed_is_refused_withdrawn_is_refused(pkmcal, sent):
    assert pkmcal("trust", sent).code == 0
    assert pkmcal("export", sent, "--force").code == 0
    assert (sent / "mark").exists()
    listed = pkmcal("trust", "--list", "--json").document
    assert listed["trusted"] == {Program.read(sent / "my.py").sha256: str(sent / "my.py")}
    with (sent / "my.py").open("a", encoding="utf-8") as file:
        file.write("# changed\n")
    assert pkmcal("export", sent, "--force").code == 2
    assert pkmcal("trust", sent / "robot.yaml").code == 0
    assert pkmcal("export", sent, "--force").code == 0
    assert pkmcal("trust", sent / "my.py", "--withdraw").code == 0
    assert pkmcal("export", sent, "--force").code == 2


def test_the_one_question_on_a_terminal_trusts(pkmcal, sent, monkeypatch):
    monkeypatch.setattr("sys.stdin", Keyboard("n\n"))
    refused = pkmcal("export", sent, "--force")
    assert refused.code == 2
    assert "Did you read it" in refused.err
    assert not trusted_programs()
    monkeypatch.setattr("sys.stdin", Keyboard("y\n"))
    assert pkmcal("export", sent, "--force").code == 0
    assert [*trusted_programs()] == [Program.read(sent / "my.py").sha256]


def test_a_cached_compilation_does_not_run_in_its_place(sent):
    """A folder may bring a cache for the very file that was read and trusted."""
    source = sent / "my.py"
    innocent = source.read_bytes().replace(b".touch()", b"        ")
    stat = source.stat()
    import py_compile

    py_compile.compile(str(source))
    source.write_bytes(innocent)
    os.utime(source, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    trust(Program.read(source))
    open_campaign(sent)
    assert not (sent / "mark").exists()


@pytest.mark.parametrize("word", ["../out.py:OWN", "/out.py:OWN", "link.py:OWN", "loop.py:OWN"])
def test_a_program_outside_the_folder_is_refused(sent, word):
    outside = sent.parent / "out.py"
    shutil.copy(sent / "my.py", outside)
    trust(Program.read(outside))
    (sent / "link.py").symlink_to(outside)
    (sent / "loop.py").symlink_to(sent / "loop.py")
    named = word.replace("/out.py", f"{outside}") if word.startswith("/") else word
    change(sent / "robot.yaml", {"mechanism": named})
    with pytest.raises(ConfigInvalid, match=r"must be in the folder|cannot be read"):
        read_robot(sent / "robot.yaml")
    assert not (sent / "mark").exists()
    assert not (sent.parent / "mark").exists()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("raise SystemExit(0)", "SystemExit 0"),
        ("raise SystemExit", "SystemExit"),
        ("raise GeneratorExit", "GeneratorExit"),
        ("while True:\n    pass", "was not done after 0.2 s"),
        (WAITS, "was not done after 0.2 s"),
        ("OWN = (", "SyntaxError"),
        ("\0", "null bytes"),
    ],
)  # fmt: skip
def test_a_trusted_program_that_ends_oddly_is_a_named_error(
    pkmcal, sent, monkeypatch, text, reason
):
    monkeypatch.setattr(program, "LONGEST_RUN_S", 0.2)
    (sent / "my.py").write_text(text, encoding="utf-8")
    assert pkmcal("trust", sent).code == 0
    for words in (("status",), ("export", "--force")):
        ended = pkmcal(words[0], sent, *words[1:])
        assert ended.code == 2
        assert reason in ended.error_line


def test_a_pipe_and_a_device_are_refused_unread(pkmcal, sent):
    (sent / "my.py").unlink()
    os.mkfifo(sent / "my.py")
    assert "is no file but a pipe" in pkmcal("status", sent).error_line
    (sent / "my.py").unlink()
    (sent / "my.py").write_bytes(b"#" * 1_100_000)
    assert "has more than 1 MB" in pkmcal("export", sent, "--force").error_line


def test_the_typed_program_is_trusted_with_its_copy(pkmcal, sent, tmp_path):
    made = tmp_path / "made"
    assert pkmcal("new", made, "--robot", f"{sent / 'my.py'}:OWN", "--offline").code == 0
    assert pkmcal("plan", made, "--shots", 4).code == 0


def test_the_list_is_the_users(configuration, sent):
    with pytest.raises(ProgramUntrusted):
        open_campaign(sent)
    trust(Program.read(sent / "my.py"))
    assert (configuration / "pkmcal" / "trusted").is_file()
    assert "my" not in sys.modules


def test_a_folders_name_puts_no_second_program_on_the_list(sent, tmp_path):
    folder = tmp_path / f"cell\n{'b' * 64}  my.py"
    folder.mkdir()
    shutil.copy(sent / "my.py", folder)
    trust(Program.read(folder / "my.py"))
    assert [*trusted_programs()] == [Program.read(sent / "my.py").sha256]
