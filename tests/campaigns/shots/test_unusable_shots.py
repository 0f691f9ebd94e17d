"""What no shot can be is refused when shots are made, by name and row."""

import numpy as np
import pytest

from campaigns.errors import ShotsInvalid
from pkmcal import Shots, find_robot

ROBOT = find_robot("delta")
JOINTS = np.radians(np.linspace(10.0, 40.0, 15).reshape(5, 3))
POINTS = np.arange(15.0).reshape(5, 3)
COVARIANCES = np.tile(1e-4 * np.eye(3), (5, 1, 1))


def changed(values, at, value):
    values = values.copy()
    values[at] = value
    return values


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"joints": changed(JOINTS, (2, 1), np.nan)}, "row 2: q1 is nan, must be finite → "),
        ({"points": changed(POINTS, (4, 2), -np.inf)}, "row 4: z is -inf, must be finite → "),
        (
            {"covariance_mm2": changed(COVARIANCES, (1, 0, 0), np.nan)},
            "row 1: its covariance is not finite and positive definite → ",
        ),
        (
            {"covariance_mm2": -np.eye(3)},
            "row 0: its covariance is not finite and positive definite → ",
        ),
        ({"pairs": [0, 0, 1, 0, 1]}, "pair 0 has 3 shots, rows 0, 1 and 3, must be two → "),
    ],
)
def test_arrays_that_hold_no_shots_are_refused(given, said):
    values = {"joints": JOINTS, "points": POINTS} | given
    with pytest.raises(ShotsInvalid) as caught:
        Shots.of(values.pop("joints"), values.pop("points"), ROBOT, **values)
    assert str(caught.value).startswith(said)


def test_a_covariance_of_another_shape_is_refused():
    with pytest.raises(
        ValueError, match=r"covariance_mm2 has shape \(2, 2\), must have \(5, 3, 3\)"
    ):
        Shots.of(JOINTS, POINTS, ROBOT, covariance_mm2=np.eye(2))


def test_covariances_that_are_not_stated_are_nan():
    stated = changed(COVARIANCES, 3, np.nan)
    shots = Shots.of(JOINTS, POINTS, ROBOT, covariance_mm2=stated, pairs=np.array([0, 0, 1, 1, 2]))
    assert np.isnan(shots.stated_covariance_mm2[3]).all()
    assert shots.pairs == (0, 0, 1, 1, 2)


def test_a_pair_may_have_two_shots_of_each_set():
    sets = ["identification"] * 2 + ["validation"] * 2 + ["drift"]
    assert len(Shots.of(JOINTS, POINTS, ROBOT, sets=sets, pairs=[0, 0, 0, 0, None])) == 5
