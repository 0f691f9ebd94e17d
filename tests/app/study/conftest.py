"""A small campaign with a plan, to study."""

import shutil

import pytest

from app.main import run_command


@pytest.fixture(scope="session")
def planned_once(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study") / "small"
    assert run_command(["new", str(folder), "--scenario", "paper-simulation"]) == 0
    assert run_command(["plan", str(folder), "--shots", "40"]) == 0
    return folder


@pytest.fixture
def folder(planned_once, tmp_path):
    """A copy of its own for a test."""
    return shutil.copytree(planned_once, tmp_path / "small")
