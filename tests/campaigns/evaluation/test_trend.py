"""Trends over campaigns: slopes with their σ, what jumps, and when the next check is due."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from campaigns.estimation.information import WorkspaceSample, weighted_line
from campaigns.evaluation.trend import Epoch, next_check, trends
from campaigns.evaluation.validation import MeasuredLength

START = datetime(2026, 1, 1, tzinfo=UTC)
UNITS = {f"p{number}": "mm" for number in range(20)}


def epoch(day, values, std, *, folder=None, kind="campaign", after_mm=None):
    names = list(UNITS)[: len(values)]
    return Epoch(
        folder=folder or f"c{day}",
        kind=kind,
        measured_utc=(START + timedelta(days=day)).isoformat(),
        decision="pass",
        says="",
        values=dict(zip(names, values, strict=True)),
        std=dict.fromkeys(names, std),
        position_std_mm=0.01,
        after=None if after_mm is None else MeasuredLength(after_mm, 0.001),
    )


def told(epochs, *, limit_mm=None, now=START):
    """Two points 1 m apart, the second of which every parameter moves along and across."""
    found = trends(epochs, UNITS)
    jacobian = np.zeros((2, 3, len(UNITS)))
    jacobian[1] = [[1.0], [1.0], [0.0]]
    points = np.array([[0.0, 0.0, 0.0], [1000.0, 0.0, 0.0]])
    sample = WorkspaceSample(tuple(UNITS), jacobian, points)
    return found, next_check(epochs, found, sample, limit_mm, now)


def test_a_slope_is_recovered_and_scatters_by_its_std():
    rng, days = np.random.default_rng(1), np.array([0.0, 30.0, 80.0, 200.0])
    std = np.array([0.01, 0.02, 0.01, 0.03])
    lines = [
        weighted_line(days, 5.0 + 0.001 * days + rng.normal(0.0, std), std, range(4))
        for _ in range(2000)
    ]
    rates, stated = np.array([line.rate for line in lines]), lines[0].rate_std
    assert rates.mean() == pytest.approx(0.001, abs=4.0 * stated / 2000**0.5)
    assert rates.std() == pytest.approx(stated, rel=0.06)
    assert np.mean([line.misfit_p < 0.1 for line in lines]) == pytest.approx(0.1, abs=0.025)


@pytest.mark.parametrize("shared", [0.0, 0.9])
def test_what_does_not_drift_shows_no_trend_in_100_series(shared):
    """Also where campaigns and two checks each share most of their errors."""
    rng, found = np.random.default_rng(2), []
    for _ in range(100):
        common = {folder: rng.normal(0.0, shared**0.5, 20) for folder in "ab"}
        every = [
            epoch(day, common[folder] + rng.normal(0.0, (1.0 - shared) ** 0.5, 20), 1.0, folder=f)
            for day, folder in ((0, "a"), (20, "a"), (40, "a"), (41, "b"), (60, "b"), (80, "b"))
            for f in [folder if shared else f"{folder}{day}"]
        ]
        found.append(told(every)[1].says)
    assert set(found) == {"no trend in 6 campaigns over 80 days"}


def test_the_next_check_is_due_when_the_drift_with_2_std_uses_up_the_limit():
    every = [epoch(day, [0.001 * day], 0.001, after_mm=0.02) for day in (0, 50, 100)]
    (trend,), due = told(every, limit_mm=0.12)
    assert trend.drifts
    assert trend.line.rate == pytest.approx(0.001)
    assert trend.line.rate_std == pytest.approx(0.001 / 5000**0.5)
    per_day = 0.001 + 2.0 * 0.001 / 5000**0.5  # across the distance it counts for nothing
    assert due.mm_per_day == pytest.approx(per_day)
    days = (datetime.fromisoformat(due.due_utc) - START).total_seconds() / 86400.0
    assert days == pytest.approx(100.0 + 0.1 / per_day, abs=1e-4)
    assert "the mean distance error reaches 0.12 mm" in due.says
    assert "due since" in told(every, limit_mm=0.12, now=START + timedelta(days=999))[1].says


def test_without_a_limit_it_is_due_when_u_of_positions_doubles():
    every = [epoch(day, [0.001 * day], 0.001, after_mm=0.02) for day in (0, 50, 100)]
    due = told(every)[1]
    assert due.room_mm == pytest.approx(0.02)
    per_day = (0.001 + 2.0 * 0.001 / 5000**0.5) * 2**0.5 / 2.0  # one of two points moves by √2
    assert due.mm_per_day == pytest.approx(per_day)


def test_parameters_that_drift_together_are_due_sooner_than_each():
    alone = [epoch(day, [0.001 * day, 0.0], 0.001) for day in (0, 50, 100)]
    both = [epoch(day, [0.001 * day, 0.001 * day], 0.001) for day in (0, 50, 100)]
    against = [epoch(day, [0.001 * day, -0.001 * day], 0.001) for day in (0, 50, 100)]
    speed = told(alone)[1].mm_per_day
    assert told(both)[1].mm_per_day == pytest.approx(2.0 * speed)
    assert told(against)[1].mm_per_day == pytest.approx(speed), "one may end before the other"


def test_what_jumped_is_named_and_foretells_nothing():
    every = [epoch(day, [0.1 * (day >= 50)], 0.001) for day in (0, 50, 100, 150)]
    assert told(every)[1].says == (
        "no trend in 4 campaigns over 150 days; changed, but not steadily: p0"
    )


def test_two_times_tell_no_trend_however_many_folders():
    every = [epoch(day, [0.1 * day], 0.001, folder=f) for f, day in (("a", 0), ("b", 9), ("c", 9))]
    assert (
        told(every)[1].says
        == "no trend can be told of 3 campaigns over 9 days: it takes 3 different days"
    )


def test_a_repair_within_a_day_is_no_trend():
    every = [epoch(day, [0.1 * (day > 0.001)], 0.001, folder="a") for day in (0, 0.001, 0.002)]
    (trend,), due = told(every)
    assert trend.line is None
    assert due.says == "no trend can be told of 3 campaigns over 0 days: it takes 3 different days"
