"""The plans of these tests are few, and run again and again: what they need is looked for once."""

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from campaigns.fit.error_model import ErrorModel, Observations
from campaigns.kinematics.mechanism import Kinematics
from campaigns.measuring import uncertainty_monitor
from campaigns.planning.paths import RobotModel


def remembered(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, which answers what it was asked before without work."""
    found: dict[tuple[object, ...], Any] = {}

    def once(*asked: object) -> Any:
        key = tuple(told(each) for each in asked)
        if key not in found:
            found[key] = function(*asked)
        return found[key]

    return once


def told(asked: object) -> object:
    match asked:
        case np.ndarray():
            return asked.tobytes()
        case Kinematics():  # mechanisms of a name differ: by the half that carries the reflector
            return asked.mechanism, asked.p.tobytes()
        case RobotModel():
            return tuple(map(told, (asked.kinematics, asked.limits, asked.centre, asked.space)))
        case ErrorModel():
            return asked.names, asked.tolerance.tobytes(), told(asked.nominal)
        case Observations():
            return tuple(told(getattr(asked, each.name)) for each in fields(asked))
        case dict():
            return tuple((name, told(value)) for name, value in asked.items())
        case _:
            return repr(asked)


SAFE_PATH = remembered(RobotModel.safe_path)
JUDGED_POSITIONS = remembered(uncertainty_monitor.judged_positions)
FIT_WITH_CHANGES = remembered(uncertainty_monitor.fit_with_changes)


@pytest.fixture(autouse=True)
def looked_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """For these tests alone: others of the process come with other robots."""
    monkeypatch.setattr(RobotModel, "safe_path", SAFE_PATH)
    monkeypatch.setattr(uncertainty_monitor, "judged_positions", JUDGED_POSITIONS)
    monkeypatch.setattr(uncertainty_monitor, "fit_with_changes", FIT_WITH_CHANGES)
