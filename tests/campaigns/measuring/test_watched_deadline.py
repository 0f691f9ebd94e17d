"""Deadlines of waits: as stated for whoever looks often, and later for whoever could not."""

import pytest
from timed_pipe import HandClock

from campaigns.measuring.watched_deadline import FEWEST_LOOKS, WatchedDeadline


@pytest.mark.parametrize("pause_s", [0.02, 0.5, 1.0])
def test_watched_deadline_passes_at_its_time_where_looks_come_often(pause_s):
    clock = HandClock()
    deadline = WatchedDeadline(clock, 10.0)
    while not deadline.has_passed():
        clock.sleep_s(pause_s)
    assert clock.now_s() == pytest.approx(10.0)


@pytest.mark.parametrize("pause_s", [1.5, 9.0, 1e6])
def test_watched_deadline_passes_only_after_looks_enough_however_late_they_come(pause_s):
    clock, looks = HandClock(), 0
    deadline = WatchedDeadline(clock, 10.0)
    while not deadline.has_passed():
        clock.sleep_s(pause_s)
        looks += 1
    assert looks == FEWEST_LOOKS


def test_one_long_sleep_costs_a_watched_deadline_only_its_share():
    clock = HandClock()
    deadline = WatchedDeadline(clock, 10.0)
    clock.sleep_s(3600.0)
    while not deadline.has_passed():
        clock.sleep_s(0.5)
    assert clock.now_s() == pytest.approx(3609.0)
