"""The plans of these tests are few, and run again and again: each way is looked for once."""

from collections.abc import Iterator

import numpy as np
import pytest

from campaigns.planning import paths

Found = dict[tuple[object, ...], list[np.ndarray] | None]


@pytest.fixture(scope="session", autouse=True)
def ways_once() -> Iterator[None]:
    found: Found = {}
    route = paths.route

    def remembered(kinematics, limits, start, end, centre, *space):
        arrays = (np.asarray(each).tobytes() for each in (kinematics.p, start, end, centre))
        asked = (kinematics.mechanism.name, *arrays, repr(limits), repr(space))
        if asked not in found:
            found[asked] = route(kinematics, limits, start, end, centre, *space)
        return found[asked]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(paths, "route", remembered)
        yield
