"""Asking again until something is so, or time is over."""

from timed_pipe import HandClock

from drivers.polling import ask_until, comes_true


def test_first_settled_answer_is_returned_without_a_further_question():
    clock, answers = HandClock(), iter(["busy", "busy", "ready", "gone"])
    found = ask_until(
        lambda answer: answer != "busy", lambda: next(answers), clock, give_up_s=9.0, pause_s=0.5
    )
    assert (found, clock.now_s()) == ("ready", 1.0)


def test_last_answer_is_returned_when_none_settles_in_time():
    clock = HandClock()
    found = ask_until(lambda _: False, clock.now_s, clock, give_up_s=2.0, pause_s=0.5)
    assert found == clock.now_s() == 2.0


def test_condition_is_tried_once_also_when_time_is_over():
    clock = HandClock()
    assert comes_true(lambda: True, clock, give_up_s=-1.0, pause_s=0.5)
    assert not comes_true(lambda: False, clock, give_up_s=-1.0, pause_s=0.5)
    assert clock.now_s() == 0.0
