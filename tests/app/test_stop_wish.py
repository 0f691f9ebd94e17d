"""Signals: a wish to stop while the robot works, an end for a server."""

import signal

import pytest

from app.interrupt import WATCHED, StopRequest, awaited_signal, stop_on_signals


@pytest.mark.parametrize("number", WATCHED)
def test_a_signal_becomes_a_wish(number):
    wish = StopRequest()
    with stop_on_signals(wish):
        assert not wish()
        signal.raise_signal(number)
        assert wish()
    assert wish.may_go_on is (number == signal.SIGINT), "only Ctrl-C has somebody to ask"


def test_asking_again_changes_nothing():
    wish = StopRequest()
    with stop_on_signals(wish):
        for _ in range(10):
            signal.raise_signal(signal.SIGINT)
    assert wish()
    assert wish.may_go_on


def test_ctrl_c_and_then_a_lost_terminal_asks_nobody():
    wish = StopRequest()
    with stop_on_signals(wish):
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGHUP)
    assert not wish.may_go_on


def test_afterwards_signals_do_what_they_did_before():
    before = [signal.getsignal(number) for number in WATCHED]
    with pytest.raises(ZeroDivisionError), stop_on_signals(StopRequest()):
        raise ZeroDivisionError
    assert [signal.getsignal(number) for number in WATCHED] == before
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_a_signal_that_came_before_the_wait_is_not_lost():
    with awaited_signal() as wait:
        signal.raise_signal(signal.SIGTERM)
        wait()
