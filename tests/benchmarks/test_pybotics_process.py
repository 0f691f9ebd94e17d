import subprocess
import sys

import pytest

from benchmarks.rivals import pybotics_process
from benchmarks.rivals.pybotics_process import REQUIREMENT, RivalMissing, command_line, taking_part
from benchmarks.shared.rounds import Run

ANSWERS = """
import json, sys
print(json.dumps({"pybotics": "3.1.2", "numpy": "1.26"}), flush=True)
for _ in sys.stdin:
    print(json.dumps({"seconds": 1.5, "unseen_max_mm": 0.01}), flush=True)
"""
VERSIONS_ONLY = "print('{}', flush=True); input()"


def script(text):
    return [sys.executable, "-I", "-S", "-c", text]


def test_every_call_is_a_round_in_the_other_process():
    with taking_part(script(ANSWERS)) as rival:
        assert rival.versions == "pybotics 3.1.2, numpy 1.26"
        assert [rival(), rival()] == [Run(1.5, 0.01)] * 2


@pytest.mark.parametrize("text", ["", VERSIONS_ONLY])
def test_rival_that_ends_is_missing(text):
    with pytest.raises(RivalMissing, match="ended"), taking_part(script(text)) as rival:
        rival()


@pytest.fixture
def executed(monkeypatch):
    """Commands that would make the environment, none of which is run."""
    commands = []

    def run(command, **_options):
        commands.append(command)
        if command[2] == "venv":
            command[-1].mkdir(parents=True)

    monkeypatch.setattr(pybotics_process.subprocess, "run", run)
    return commands


def test_environment_is_made_and_installed_once(executed, tmp_path):
    assert command_line(tmp_path) == command_line(tmp_path)
    assert [command[2] for command in executed] == ["venv", "pip"]
    assert executed[1][-1] == REQUIREMENT


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (
            subprocess.CalledProcessError(1, "pip", stderr=b"WARNING: -\nERROR: none\n"),
            "ERROR: none",
        ),
        (subprocess.TimeoutExpired("venv", 300.0), "300"),
    ],
)
def test_environment_that_cannot_be_made_is_one_line_and_tried_again(
    monkeypatch, tmp_path, error, reason
):
    def run(*_, **__):
        raise error

    monkeypatch.setattr(pybotics_process.subprocess, "run", run)
    for _ in range(2):
        with pytest.raises(RivalMissing, match=f"{REQUIREMENT}.*: .*{reason}"):
            command_line(tmp_path)
