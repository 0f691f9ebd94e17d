"""Workspaces and true robots that many tests of campaigns begin with are computed once."""

import pytest
from remembered import remembered

from benchmarks.observed_truths import TrueBodies
from campaigns.kinematics.model import Kinematics


@pytest.fixture(autouse=True, scope="session")
def begun_once():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Kinematics, "feasibility", remembered(Kinematics.feasibility))
        patch.setattr(TrueBodies, "stood", remembered(TrueBodies.stood))
        yield
