"""The plans of these tests are few, and run again and again: each way is looked for once."""

from collections.abc import Iterator

import numpy as np
import pytest

from campaigns.planning.paths import RobotModel

Found = dict[tuple[object, ...], list[np.ndarray] | None]


@pytest.fixture(scope="session", autouse=True)
def ways_once() -> Iterator[None]:
    found: Found = {}
    safe_path = RobotModel.safe_path

    def remembered(robot: RobotModel, start: np.ndarray, end: np.ndarray):
        arrays = (robot.kinematics.p, start, end, robot.centre)
        name = robot.kinematics.mechanism.name
        limits, space = repr(robot.limits), repr(robot.space)
        asked = (name, limits, space, *(np.asarray(each).tobytes() for each in arrays))
        if asked not in found:
            found[asked] = safe_path(robot, start, end)
        return found[asked]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RobotModel, "safe_path", remembered)
        yield
