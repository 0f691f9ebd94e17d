"""The front of the command line: help, usage errors, one line for whatever goes wrong."""

import ast
import inspect
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from app import main
from app.interrupt import WATCHED
from app.main import run_command
from campaigns.version import COMMIT_FILE, commit
from drivers.errors import EmergencyStop, LinkDown, RobotStateUnknown

COMMANDS = tuple(main.COMMANDS)
REPOSITORY = Path(__file__).parents[2]
HEAVY = {
    *("numpy", "scipy", "pydantic", "rich", "ruamel.yaml", "serial", "campaigns.fit", "sim.cell")
}


def test_without_arguments_it_shows_the_usual_commands_on_a_small_terminal(pkmcal):
    code, out, err = pkmcal()
    lines = out.splitlines()
    assert (code, err) == (0, "")
    assert len(lines) <= 22, "24 lines with the prompts"
    assert max(map(len, lines)) <= 80
    listed = [line.split()[0] for line in lines if line.startswith("  ")]
    assert listed == [*COMMANDS][: main.FIRST_COMMANDS]


def test_help_lists_all_commands(pkmcal):
    _, out, _ = pkmcal("--help")
    usual, _, others = out.partition("More commands:")
    listed = [line.split()[0] for line in (usual + others).splitlines() if line[2:3].islower()]
    assert [name for name in listed if name in COMMANDS] == [*COMMANDS]
    assert " watch " in usual
    assert " dry-run " in others


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself_as_the_list_of_commands_does(pkmcal, command):
    module, summary = main.COMMANDS[command]
    text = inspect.getdoc(import_module(f"app.cli.{module}").command)
    assert text.splitlines()[0] == summary
    code, out, _ = pkmcal(command, "--help")
    assert code == 0
    assert "Usage: pkmcal" in out
    assert max(map(len, out.splitlines())) <= 100
    assert not re.search(r"list\[|<|\[\[|\{[A-Z]|x>=", out), "names of types"
    assert ("--json" in out) is (command != "sim"), "programs are spoken to"
    assert out.index("\nOutput:\n") < out.index("-h, --help"), "in one section in every process"
    moves_or_changes = command in {"run", "validate", "check", "load"}
    assert ("--dry" in out and "--yes" in out) is moves_or_changes


def test_it_knows_its_version(pkmcal, tmp_path):
    code, out, _ = pkmcal("--version")
    assert code == 0
    assert out.startswith("pkmcal ")
    (tmp_path / "version.py").touch()
    assert commit(tmp_path) == ""
    (tmp_path / COMMIT_FILE).write_text("1234567\n")
    assert commit(tmp_path) == "1234567"


@pytest.mark.parametrize(
    ("words", "code"),
    [(("-m", "pkmcal", "--version"), 2), (("-c", "from pkmcal import find_robot"), 1)],
    ids=["command line", "Python API"],
)
def test_folder_that_hides_our_packages_is_named(tmp_path, words, code):
    (tmp_path / "app").mkdir()
    (tmp_path / "app" / "__init__.py").touch()
    done = subprocess.run(
        [sys.executable, *words],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(map(str, (tmp_path, REPOSITORY)))},
        cwd=tmp_path.parent,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stderr
    assert f"{tmp_path / 'app'} stands in the way of pkmcal's own package app" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fly"], ["No such command 'fly'", "`pkmcal --help`"]),
        (["plan"], ["holds no campaign.yaml", "`pkmcal new DIR`"]),
        (["plan", "x", "--shot", "5"], ["--shot", "`pkmcal plan --help`"]),
        (["plan", "x", "--shots", "7"], ["7", "even"]),
        (["validate", "x"], ["--stage"]),
        (["load", "x", "--rollback", "--robot", "y"], ["--rollback and --robot contradict"]),
        (["new", "x", "--controller", "tcp://h:1", "--tracker", "tcp://h:2", "--scenario", "s"],
         ["--scenario", "--controller"]),
        (["import", "."], ["FILE is missing"]),
        (["identify", "x", "--only-shots", "all"], ["--only-shots is 'all'", "0-60, -60 or 61-"]),
        (["identify", "x", "--hold-out", "80%"], ["--hold-out is 0.8", "20% is usual"]),
    ],
)  # fmt: skip
def test_a_command_that_makes_no_sense(pkmcal, arguments, words, tmp_path, monkeypatch):
    alone = tmp_path / "shop" / "floor"  # no campaign lies beside it
    alone.mkdir(parents=True)
    monkeypatch.chdir(alone)
    ended = pkmcal(*arguments, "--json")
    assert (ended.code, ended.document["error"]["exit_code"]) == (2, 2)
    assert ended.err == f"pkmcal: {ended.error_line}\n"
    for word in words:
        assert word in ended.err


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["validate", "--stage", "befor"], "--stage is 'befor' → use before or after; see"),
        (["plan", "--shots", "abc"], "--shots is 'abc' → give a whole number; see"),
        (["plan", "--shots=-1"], "--shots is '-1' → give 0 or more; see"),
    ],
)
def test_a_value_that_an_option_cannot_take_is_one_plain_line(pkmcal, arguments, line):
    code, _, err = pkmcal(*arguments)
    assert code == 2
    assert err == f"pkmcal: {line} `pkmcal {arguments[0]} --help`\n"


@pytest.fixture
def failing(monkeypatch, tmp_path):
    """Makes `pkmcal devices` end in an error; gives its words."""

    def fail_with(error):
        def opened(folder):
            raise error

        monkeypatch.setattr("app.options.open_campaign", opened)
        return "devices", str(tmp_path)

    return fail_with


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (LinkDown("a\nb", remedy="check it"), 3, "a b → check it"),
        (ZeroDivisionError("by nothing"), 70, "unforeseen ZeroDivisionError: by nothing → report"),
        (KeyboardInterrupt(), 130, "interrupted → start the command again"),
    ],
)
def test_whatever_goes_wrong_is_one_line_and_a_document(pkmcal, failing, error, code, line):
    ended = pkmcal(*failing(error), "--json")
    assert ended.code == ended.document["error"]["exit_code"] == code
    assert ended.err == f"pkmcal: {ended.error_line}\n"
    assert ended.error_line.startswith(line)


@pytest.mark.parametrize("error", [LinkDown("a", remedy="b"), ZeroDivisionError("a")])
def test_debug_shows_where_it_arose(pkmcal, failing, error):
    words = failing(error)
    assert "Traceback" not in pkmcal(*words)[2]
    code, _, err = pkmcal("--debug", *words)
    assert code in {3, 70}
    assert "Traceback" in err
    assert "in opened" in err
    assert err.splitlines()[-1].startswith("pkmcal: ")


def test_a_lost_or_stopped_device_names_the_command_that_resumes(pkmcal, failing):
    """Only of what measures; the robot's stop comes first."""
    _, folder = failing(RobotStateUnknown("no answer", remedy="use the hardware stop"))
    line = pkmcal("validate", folder, "--stage", "before").error_line
    assert line.startswith("PRESS THE EMERGENCY STOP: no answer → use the hardware stop; then ")
    assert line.endswith(f"then `pkmcal validate {folder} --stage before` resumes")
    failing(EmergencyStop("it is pressed", remedy="release it"))
    assert pkmcal("run", folder).error_line.endswith(f"then `pkmcal run {folder}` resumes")
    assert "resumes" not in pkmcal("devices", folder).error_line


IMPORTED = """
import sys
from app.main import run_command
for words in ((), ("status",), ("identify",), ("study",)):
    assert run_command([*words, "--help"]) == 0
    print(sorted(sys.modules), file=sys.stderr)
"""


def test_nothing_heavy_and_no_command_is_imported_for_help():
    words = [sys.executable, "-c", IMPORTED]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    for_list, _, for_identify, for_commands = map(
        set, map(ast.literal_eval, done.stderr.splitlines())
    )
    assert not HEAVY & for_list
    assert not [name for name in for_list if name.startswith("app.cli.")]
    slow_parts = {f"scipy.{part}" for part in ("linalg", "optimize", "spatial", "special")}
    assert not slow_parts & for_commands
    assert not {"app.run_screen", "drivers.catalog", "filelock"} & for_identify


@pytest.mark.parametrize(
    ("typed", "words"),
    [
        ("pkmcal ", COMMANDS),
        ("pkmcal re", ("report",)),
        ("pkmcal plan --pl", ("--placement", "--plot")),
        ("pkmcal new x --robot linear", ("linear-delta",)),
        ("pkmcal sim re", ("realistic",)),
    ],
)
def test_what_was_typed_is_completed(capsys, monkeypatch, typed, words):
    monkeypatch.setenv("_PKMCAL_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", typed)
    monkeypatch.setenv("COMP_CWORD", str(len(typed.split(" ")) - 1))
    with pytest.raises(SystemExit, match="0"):
        run_command([])
    assert tuple(capsys.readouterr().out.split()) == words


def test_signals_that_whoever_started_us_has_blocked_are_delivered():
    heard = "import app.main as m, signal as s; m._outcome = lambda _: print(s.pthread_sigmask("
    heard += "s.SIG_BLOCK, ()) & set(s.Signals) or 'none') or 0; m.main()"
    blocked = "import os, signal as s, sys; s.pthread_sigmask(s.SIG_BLOCK, s.valid_signals()); "
    blocked += "os.execv(sys.executable, [sys.executable, '-c', sys.argv[1]])"
    words = [sys.executable, "-c", blocked, heard]
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert "SIGUSR1" in said
    for watched in WATCHED:
        assert watched.name not in said


def test_a_ctrl_c_while_an_error_is_told_changes_nothing_of_it(tmp_path):
    late = "import app.main as m, os; tell = m._explain_error; m._explain_error = lambda *said: "
    late += "os.kill(os.getpid(), 2) or tell(*said); m.main()"
    words = [sys.executable, "-c", late, "status", str(tmp_path / "nowhere")]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1), ended.stderr
