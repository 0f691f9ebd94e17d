import itertools

import pytest

from benchmarks.shared.rounds import Run, contestant, least_s, medians, ratio, take_turns


def clock_of(*moments_s):
    return iter(moments_s).__next__


def test_cost_is_the_median_of_the_repeats_and_the_answer_the_last():
    answers = itertools.count()
    clock = clock_of(0.0, 1.0, 10.0, 15.0, 20.0, 22.0)
    assert contestant(answers.__next__, 3, clock=clock)() == Run(2.0, 2)


def test_cost_of_work_in_parts_is_that_of_one_part():
    assert contestant(lambda: None, 1, parts=4, clock=clock_of(0.0, 2.0))().seconds == 0.5


def test_contestants_take_turns():
    order = []
    ours, rival = (contestant(lambda name=name: order.append(name), 1) for name in "ab")
    taken = take_turns([ours, rival], 3)
    assert order == list("ababab")
    assert [len(runs) for runs in taken] == [3, 3]


def test_ratio_is_formed_within_each_round():
    ours = [Run(1.0, None), Run(10.0, None), Run(2.0, None)]  # the second round was disturbed
    rival = [Run(9.0, None), Run(100.0, None), Run(22.0, None)]
    assert ratio(rival, ours) == (10.0, 9.0, 11.0)
    assert least_s(ours) == 1.0, "that of the round disturbed least"


def test_each_figure_has_a_median_of_its_own():
    rounds = [{"a": 1.0, "b": 9.0}, {"a": 2.0, "b": 8.0}, {"a": 3.0, "b": 7.0}]
    assert medians(rounds) == {"a": 2.0, "b": 8.0}


def test_a_round_that_fails_is_not_swallowed():
    def broken():
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        take_turns([contestant(broken, 1)], 1)
