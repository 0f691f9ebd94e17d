"""Waiting: asked again until something is so, time is over, or somebody wants to stop."""

import pytest
from timed_pipe import HandClock

from drivers.polling import NAP_S, WakefulClock, ask_until, wait_for


def test_answers_are_asked_for_until_one_settles_or_time_is_over():
    clock, answers = HandClock(), iter(["busy", "busy", "ready", "gone"])
    found = ask_until(
        lambda answer: answer != "busy", lambda: next(answers), clock, give_up_s=9.0, pause_s=0.5
    )
    assert (found, clock.now_s()) == ("ready", 1.0)
    clock = HandClock()
    found = ask_until(lambda _: False, clock.now_s, clock, give_up_s=2.0, pause_s=0.5)
    assert found == clock.now_s() == 2.0
    clock = HandClock()
    assert wait_for(lambda: True, clock, give_up_s=-1.0, pause_s=0.5)
    assert not wait_for(lambda: False, clock, give_up_s=-1.0, pause_s=0.5)
    assert clock.now_s() == 0.0


def test_sleep_ends_soon_after_somebody_wants_to_stop_and_does_not_spin():
    clock = HandClock()
    WakefulClock(clock, lambda: False).sleep_s(1.0)
    assert clock.now_s() == pytest.approx(1.0)
    clock = HandClock()
    WakefulClock(clock, lambda: clock.now_s() > 0.5).sleep_s(30.0)
    assert 0.5 < clock.now_s() <= 0.5 + NAP_S + 1e-9
    clock = HandClock()
    WakefulClock(clock, lambda: True).sleep_s(30.0)
    assert clock.now_s() == NAP_S
