"""The plans of these tests are few and run often: their ways and fits are computed once."""

import pickle
from collections.abc import Callable
from typing import Any

import pytest

from campaigns.measuring import uncertainty_monitor
from campaigns.planning.paths import RobotModel


def remembered(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, which answers equal arguments without work."""
    results: dict[bytes, Any] = {}

    def look_up(*arguments: object) -> Any:
        key = pickle.dumps(arguments)
        if key not in results:
            results[key] = function(*arguments)
        return results[key]

    return look_up


SAFE_WAYS = remembered(RobotModel.legs_of)
JUDGED_POSITIONS = remembered(uncertainty_monitor.judged_positions)
FIT_WITH_CHANGES = remembered(uncertainty_monitor.explain)


@pytest.fixture(autouse=True)
def computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """For these tests alone: others of the process come with other robots."""
    monkeypatch.setattr(RobotModel, "legs_of", SAFE_WAYS)
    monkeypatch.setattr(uncertainty_monitor, "judged_positions", JUDGED_POSITIONS)
    monkeypatch.setattr(uncertainty_monitor, "explain", FIT_WITH_CHANGES)
