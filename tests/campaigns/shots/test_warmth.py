"""Warmth: where the regressor of growth comes from, and at which state it is 0."""

from dataclasses import replace

import numpy as np
import pytest
from identified_cases import dataset

from campaigns.errors import ShotsInvalid
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots
from campaigns.shots.warmth import FINER, TIME_CONSTANTS, courses, finer, with_readings

COUNT = 21
LINE = np.array([0.02, -0.01, 0.03])


def run(*, drift_every: int = 5) -> Shots:
    """Shots ten minutes apart, of which some are at the drift pose."""
    purposes = [
        ShotSet.DRIFT if n % drift_every == 0 else ShotSet.REPEATABILITY for n in range(COUNT)
    ]
    points = np.tile([2000.0, 10.0, -300.0], (COUNT, 1))
    shots = dataset(np.zeros((COUNT, 4)), points, [None] * COUNT, purposes)
    times = [f"2026-11-21T{9 + n // 6:02}:{n % 6}0:00Z" for n in range(COUNT)]
    return replace(shots, measured_utc=tuple(times))


def warmed() -> np.ndarray:
    return 1.0 - np.exp(-np.arange(COUNT) / 7.0)


def test_measured_temperatures_come_first_and_count_from_the_reference() -> None:
    degC = np.full(COUNT, np.nan)
    degC[[0, 20]] = 21.0, 25.0
    (found,) = courses(replace(run(), part_temperature_degC=degC), 20.0)
    assert (found.source, found.time_constant) == ("temperature", None)
    np.testing.assert_allclose(found.values, np.linspace(1.0, 5.0, COUNT))
    np.testing.assert_allclose(found.passed, np.linspace(0.0, 1.0, COUNT))


def test_temperatures_that_hardly_change_tell_no_growth() -> None:
    found = courses(replace(run(), part_temperature_degC=np.full(COUNT, 23.0)), 20.0)
    assert {each.source for each in found} == {"time"}


def test_the_drift_pose_tells_the_course_where_it_moves_along_a_line() -> None:
    shots = run()
    moved = shots.points_in_tracker_mm + np.outer(warmed(), LINE)
    (found,) = courses(replace(shots, points_in_tracker_mm=moved), 20.0)
    assert found.source == "drift pose"
    visits = np.arange(0, COUNT, 5)
    expected = warmed()[visits] / warmed()[-1] - 1.0
    np.testing.assert_allclose(found.values[visits], expected, atol=1e-9)


def test_a_drift_pose_that_scatters_as_far_across_leaves_it_to_time() -> None:
    shots, rng = run(), np.random.default_rng(1)
    moved = shots.points_in_tracker_mm + np.outer(warmed(), LINE)
    moved = moved + 0.01 * rng.standard_normal(moved.shape)
    found = courses(replace(shots, points_in_tracker_mm=moved), 20.0)
    assert [each.time_constant for each in found] == list(TIME_CONSTANTS)


@pytest.mark.parametrize("known", [True, False], ids=["times", "order alone"])
def test_by_time_the_state_is_minus_1_at_the_start_and_0_at_the_end(known: bool) -> None:
    shots = run() if known else replace(run(), measured_utc=("",) * COUNT)
    for each in courses(shots, 20.0):
        assert (each.values[0], each.values[-1]) == (-1.0, 0.0)
        assert (np.diff(each.values) > 0.0).all()
    third = courses(shots, 20.0)[2]
    passed = np.linspace(0.0, 1.0, COUNT)
    np.testing.assert_allclose(third.passed, (1 - np.exp(-3 * passed)) / (1 - np.exp(-3)))


def test_a_course_by_time_that_slows_down_has_finer_ones_beside_it() -> None:
    shots = run(drift_every=1000)
    by_time = courses(shots, 20.0)
    shorter, longer = sorted(
        each.time_constant or 0.0 for each in finer(shots, by_time[2], FINER[0])
    )
    assert TIME_CONSTANTS[1] < shorter < TIME_CONSTANTS[2] < longer < TIME_CONSTANTS[3]
    assert finer(shots, by_time[-1], FINER[0]) == ()


def test_readings_are_joined_by_time_and_own_temperatures_stay() -> None:
    own = np.full(COUNT, np.nan)
    own[4] = 30.0
    shots = replace(run(), part_temperature_degC=own)
    read = {"2026-11-21T11:00:00+00:00": 24.0, "2026-11-21T09:00:00Z": 20.0}
    degC = with_readings(shots, read).part_temperature_degC
    np.testing.assert_allclose(degC[[0, 3, 4, 6, 12, 20]], [20.0, 21.0, 30.0, 22.0, 24.0, 24.0])
    assert with_readings(shots, {}) is shots


def test_readings_that_cannot_be_joined_are_refused() -> None:
    shots = replace(run(), measured_utc=("",) * COUNT)
    with pytest.raises(ShotsInvalid, match=r"part_temperatures .* shot 0 has no time"):
        with_readings(shots, {"2026-11-21T09:00:00Z": 20.0})
