"""Workspaces and true robots that many tests of campaigns begin with are computed once."""

import pytest
from remembered import remembered

from benchmarks.observed_truths import TrueBodies
from campaigns.kinematics.model import Kinematics

FEASIBILITY, STOOD = remembered(Kinematics.feasibility), remembered(TrueBodies.stood)


@pytest.fixture(autouse=True)
def begun_once(monkeypatch):
    monkeypatch.setattr(Kinematics, "feasibility", FEASIBILITY)
    monkeypatch.setattr(TrueBodies, "stood", STOOD)
