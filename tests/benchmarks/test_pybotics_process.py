import os
import subprocess
import sys
from io import BytesIO

import pytest

from benchmarks.rivals.pybotics_process import (
    COMPLETE,
    REQUIREMENT,
    Pybotics,
    RivalMissing,
    environment,
    taking_part,
)
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


def test_question_that_nobody_reads_says_that_the_rival_has_ended():
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "wb", buffering=0) as questions:
        rival = Pybotics("", questions, BytesIO())
        with pytest.raises(RivalMissing, match="ended"):
            rival()


def test_environment_is_made_and_installed_once(tmp_path):
    executed = []

    def execute(command):
        executed.append(command)
        tmp_path.mkdir(exist_ok=True)

    assert environment(tmp_path, execute) == environment(tmp_path, execute)
    assert [command[2] for command in executed] == ["venv", "pip"]
    assert executed[1][-1] == REQUIREMENT


def test_failed_installation_is_one_line_and_is_tried_again_next_time(tmp_path):
    def execute(command):
        if "pip" in command:
            written = b"WARNING: retrying\nERROR: no matching distribution\n"
            raise subprocess.CalledProcessError(1, "pip", stderr=written)

    with pytest.raises(RivalMissing, match=f"{REQUIREMENT}.*: ERROR: no matching distribution$"):
        environment(tmp_path, execute)
    assert not (tmp_path / COMPLETE).exists()


def test_environment_that_cannot_be_made_is_a_missing_rival(tmp_path):
    def execute(command):
        raise subprocess.TimeoutExpired("venv", 300.0)

    with pytest.raises(RivalMissing, match="300"):
        environment(tmp_path, execute)
