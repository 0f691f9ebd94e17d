"""The plans of these tests are few and run often: their ways and fits are computed once."""

from functools import cache

import pytest
from remembered import remembered

from campaigns.measuring import uncertainty_monitor
from campaigns.planning.paths import RobotModel

SAFE_WAYS = remembered(RobotModel.legs_of)
JUDGED_POSITIONS = remembered(uncertainty_monitor.judged_positions)
FIT_WITH_CHANGES = remembered(uncertainty_monitor.explain)
AVERAGED_FIT = cache(uncertainty_monitor.integrate_sizes)


@pytest.fixture(autouse=True)
def computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """For these tests alone: others of the process come with other robots."""
    monkeypatch.setattr(RobotModel, "legs_of", SAFE_WAYS)
    monkeypatch.setattr(uncertainty_monitor, "judged_positions", JUDGED_POSITIONS)
    monkeypatch.setattr(uncertainty_monitor, "explain", FIT_WITH_CHANGES)
    monkeypatch.setattr(uncertainty_monitor, "integrate_sizes", AVERAGED_FIT)
