"""A study that is killed: nothing of it stays behind, and nothing of its table is torn."""

import subprocess
import sys
import time

import psutil
import pytest

from app.main import run_command

pytestmark = pytest.mark.long

TABLE = "plan-paper-simulation.jsonl"
MANY = 999
"""More than are computed before the end."""
FEW = 40
WITHIN_S = 30.0


def rows(table):
    return table.read_text(encoding="utf-8").splitlines() if table.exists() else []


def test_killed_study_leaves_no_process_and_goes_on_as_if_nothing_had_been(planned_once, tmp_path):
    tables, other = tmp_path / "killed", tmp_path / "whole"
    options = ("--campaigns", str(MANY), "--workers", "2", "--to", str(tables))
    command = (sys.executable, "-m", "app.main", "study", str(planned_once), *options)
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as study:
        until_s = time.monotonic() + WITHIN_S
        while len(rows(tables / TABLE)) <= FEW and time.monotonic() < until_s:
            time.sleep(0.01)
        workers = psutil.Process(study.pid).children(recursive=True)
        study.kill()
    _, stayed = psutil.wait_procs(workers, timeout=WITHIN_S)
    for process in stayed:
        process.kill()
    assert len(workers) >= 2
    assert stayed == []
    assert len(rows(tables / TABLE)) < MANY
    for folder in (tables, other):
        options = ("--campaigns", str(FEW), "--workers", "1", "--to", str(folder))
        assert run_command(["study", str(planned_once), *options]) == 0
    assert rows(tables / TABLE)[: FEW + 1] == rows(other / TABLE)
