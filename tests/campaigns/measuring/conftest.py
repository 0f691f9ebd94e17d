"""The plans of these tests are few, and run again and again: what they need is looked for once."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from campaigns.measuring import uncertainty_monitor
from campaigns.mechanisms.mechanism import Kinematics
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
        case Kinematics():
            return asked.mechanism.name, asked.p.tobytes()
        case RobotModel():
            return tuple(map(told, (asked.kinematics, asked.limits, asked.centre, asked.space)))
        case _:
            return repr(asked)


@pytest.fixture(scope="session", autouse=True)
def looked_for_once() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RobotModel, "safe_path", remembered(RobotModel.safe_path))
        sample_positions = remembered(uncertainty_monitor.sample_positions)
        patch.setattr(uncertainty_monitor, "sample_positions", sample_positions)
        yield
