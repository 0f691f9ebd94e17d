"""Signals: a wish to stop while the robot works, an end for a server."""

import signal

import pytest

from app import interrupt
from campaigns.errors import Interrupted


@pytest.fixture(autouse=True)
def heeded():
    """SIGHUP as a terminal leaves it: under `nohup` the tests themselves ignore it."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.fixture
def wish():
    return interrupt.StopRequest()


@pytest.mark.parametrize("number", interrupt.WATCHED)
def test_a_signal_becomes_a_wish(wish, number):
    with interrupt.stop_on_signals(wish):
        assert not wish()
        signal.raise_signal(number)
        assert wish()
    at_the_terminal = {signal.SIGINT, signal.SIGTSTP}
    assert wish.may_go_on is (number in at_the_terminal), "nobody else is there to be asked"
    assert wish.suspends is (number == signal.SIGTSTP)


@pytest.mark.parametrize(
    ("signals", "may_go_on"),
    [
        ([signal.SIGINT] * 10, True),
        ([signal.SIGINT, signal.SIGHUP], False),
        ([signal.SIGHUP, signal.SIGINT], False),
        ([signal.SIGHUP, signal.SIGTSTP], False),
    ],
)
def test_asking_again_changes_nothing_and_with_a_lost_terminal_nobody_is_asked(
    wish, signals, may_go_on
):
    with interrupt.stop_on_signals(wish):
        for number in signals:
            signal.raise_signal(number)
    assert wish()
    assert wish.may_go_on is may_go_on
    assert not wish.suspends


@pytest.fixture
def ignored(request):
    """A signal that whoever started us has us ignore."""
    before = signal.signal(request.param, signal.SIG_IGN)
    yield request.param
    signal.signal(request.param, before)


@pytest.mark.parametrize("ignored", [signal.SIGHUP, signal.SIGTSTP], indirect=True)
def test_what_nohup_has_us_ignore_stays_ignored(wish, ignored):
    with interrupt.stop_on_signals(wish):
        signal.raise_signal(ignored)
        assert not wish()
    assert signal.getsignal(ignored) is signal.SIG_IGN


@pytest.mark.parametrize("ignored", [signal.SIGINT], indirect=True)
def test_ctrl_c_is_heard_although_a_run_was_started_in_the_background(wish, ignored):
    with interrupt.stop_on_signals(wish):
        signal.raise_signal(ignored)
    assert wish()


def test_afterwards_signals_do_what_they_did_before():
    before = [signal.getsignal(number) for number in interrupt.WATCHED]
    with pytest.raises(ZeroDivisionError), interrupt.stop_on_signals(interrupt.StopRequest()):
        raise ZeroDivisionError
    assert [signal.getsignal(number) for number in interrupt.WATCHED] == before
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_a_signal_that_came_before_the_wait_is_not_lost():
    with interrupt.awaited_signal() as wait:
        signal.raise_signal(signal.SIGTERM)
        wait()


def test_a_late_ctrl_c_changes_nothing_of_a_stop_that_was_made():
    stopped = Interrupted("stopped by the operator", remedy="the same command resumes it")

    def end_late():
        try:
            raise stopped
        finally:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted), interrupt.first_stop_counts():
        end_late()
