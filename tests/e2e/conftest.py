"""Campaigns on a small, fast simulated cell, at the stages at which tests take them up."""

import shutil
from dataclasses import replace
from functools import partial

import pytest
from command_line import change, ran

from drivers import catalog
from drivers.emscon.client import EmsconDeadlines
from drivers.emscon.tracker import EmsconTracker
from drivers.robotline import LineRobot, RobotlineDeadlines

TINY = {"plan.shots": 8, "plan.validation_pairs": 0, "plan.drift_shots": 2}
IMPATIENT_ROBOT = RobotlineDeadlines(answer_s=0.3, stop_answer_s=0.3, standstill_s=3.0)
IMPATIENT_TRACKER = EmsconDeadlines(answer_s=0.3, measuring_margin_s=0.3)


@pytest.fixture
def impatient(monkeypatch):
    """Drivers that give up soon; `undo` makes them patient again."""
    robot = partial(LineRobot, deadlines=IMPATIENT_ROBOT)
    driver = replace(catalog.CONTROLLERS["robotline"], make=robot)
    monkeypatch.setitem(catalog.CONTROLLERS, "robotline", driver)
    tracker = partial(EmsconTracker, deadlines=IMPATIENT_TRACKER)
    driver = replace(catalog.TRACKERS["emscon"], make=tracker)
    monkeypatch.setitem(catalog.TRACKERS, "emscon", driver)
    return monkeypatch


@pytest.fixture(scope="session")
def tiny_once(made_once, planned_once):
    def make(folder):
        shutil.copytree(planned_once, folder)
        change(folder / "campaign.yaml", TINY)
        ran(folder, "plan")

    return made_once("tiny", make)


@pytest.fixture
def tiny(tiny_once, tmp_path):
    """A campaign of ten shots."""
    return shutil.copytree(tiny_once, tmp_path / "tiny")


@pytest.fixture(scope="session")
def measured_once(made_once, planned_once):
    def make(folder):
        shutil.copytree(planned_once, folder)
        ran(folder, "run --yes")

    return made_once("measured", make)


@pytest.fixture
def measured(measured_once, tmp_path):
    """A campaign whose plan has been measured."""
    return shutil.copytree(measured_once, tmp_path / "measured")


@pytest.fixture(scope="session")
def exported_once(made_once, measured_once):
    def make(folder):
        shutil.copytree(measured_once, folder)
        ran(folder, "identify", "export")

    return made_once("exported", make)


@pytest.fixture
def exported(exported_once, tmp_path):
    """A campaign whose parameters are identified and exported, but not loaded."""
    return shutil.copytree(exported_once, tmp_path / "exported")
