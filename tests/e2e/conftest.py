"""Campaigns on a small, fast simulated cell, at the stages at which tests take them up."""

import os
import shutil

import pytest
from command_line import CommandLine, change

from app.main import LINEAR_ALGEBRA_THREADS, run_command

for variable in LINEAR_ALGEBRA_THREADS:  # as `main` does, before anything imports NumPy
    os.environ.setdefault(variable, "1")

SMALL = {
    "settle.timeout_s": 300,  # of the cell's time: a busy machine may look up late
    "plan.shots": 48,
    "plan.validation_pairs": 4,
    "validation.repeatability_approaches": 3,
    "validation.rotation_steps": 3,
    "validation.line_points": 3,
}
TINY = {"plan.shots": 8, "plan.validation_pairs": 0, "plan.drift_shots": 2}
FAST = {"speed_up": 1000}


@pytest.fixture
def pkmcal(capsys):
    """Runs a command and tells how it ended."""
    return CommandLine(capsys)


@pytest.fixture(scope="session")
def planned_once(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaigns") / "small"
    assert run_command(["new", str(folder), "--scenario", "paper-simulation"]) == 0
    change(folder / "campaign.yaml", SMALL)
    change(folder / "cell.yaml", FAST)
    assert run_command(["plan", str(folder)]) == 0
    return folder


@pytest.fixture
def planned(planned_once, tmp_path):
    """A campaign with a plan, and nothing measured."""
    return shutil.copytree(planned_once, tmp_path / "small")


@pytest.fixture(scope="session")
def tiny_once(planned_once, tmp_path_factory):
    folder = shutil.copytree(planned_once, tmp_path_factory.mktemp("campaigns") / "tiny")
    change(folder / "campaign.yaml", TINY)
    assert run_command(["plan", str(folder)]) == 0
    return folder


@pytest.fixture
def tiny(tiny_once, tmp_path):
    """A campaign of ten shots."""
    return shutil.copytree(tiny_once, tmp_path / "tiny")


@pytest.fixture(scope="session")
def measured_once(planned_once, tmp_path_factory):
    folder = shutil.copytree(planned_once, tmp_path_factory.mktemp("campaigns") / "measured")
    assert run_command(["run", str(folder), "--yes"]) == 0
    return folder


@pytest.fixture
def measured(measured_once, tmp_path):
    """A campaign whose plan has been measured."""
    return shutil.copytree(measured_once, tmp_path / "measured")


@pytest.fixture(scope="session")
def exported_once(measured_once, tmp_path_factory):
    folder = shutil.copytree(measured_once, tmp_path_factory.mktemp("campaigns") / "exported")
    assert run_command(["identify", str(folder)]) == 0
    assert run_command(["export", str(folder)]) == 0
    return folder


@pytest.fixture
def exported(exported_once, tmp_path):
    """A campaign whose parameters are identified and exported, but not loaded."""
    return shutil.copytree(exported_once, tmp_path / "exported")
