import numpy as np
import pytest

from benchmarks import against_rivals
from benchmarks.against_rivals import (
    LEAST_OF_LAB,
    SAME_PARAMETERS,
    Contest,
    serial_arm,
    solver_line,
)
from benchmarks.rivals.pybotics_process import RivalMissing
from benchmarks.shared.measured_robot import FREE, measured_robot
from benchmarks.shared.rounds import Run
from benchmarks.study_workers import Gains, medians

ANSWER = np.zeros(len(FREE))
OURS = [Run(1.0, ANSWER)] * 3


def rival(seconds, answer=ANSWER):
    return solver_line("lab", [Run(seconds, answer)] * 3, OURS, LEAST_OF_LAB)


def test_rival_that_is_slow_enough_and_agrees_has_no_fault():
    assert rival(LEAST_OF_LAB).fault == ""


def test_ratio_below_what_is_asked_for_is_a_fault_with_value_and_limit():
    assert rival(899.0).fault == "takes 899 times as long, asked for 900"


@pytest.mark.parametrize("off", [2.0 * SAME_PARAMETERS.mm, np.nan])
def test_ratio_against_other_parameters_is_worth_nothing(off):
    assert "worth nothing" in rival(2.0 * LEAST_OF_LAB, np.full(len(FREE), off)).fault


def test_a_contest_names_its_faults():
    contest = Contest("60 distances", (rival(LEAST_OF_LAB), rival(1.0)))
    assert contest.faults() == ["60 distances: lab takes 1 times as long, asked for 900"]


def test_without_pybotics_one_line_says_why_and_nothing_is_missed(monkeypatch):
    def no_network():
        raise RivalMissing("no network")

    monkeypatch.setattr(against_rivals, "command_line", no_network)
    contest = serial_arm(measured_robot(), 1)
    assert contest.title.endswith("not compared, no network")
    assert contest.faults() == []


def test_workers_are_asked_for_nine_tenths_of_what_the_machine_gives():
    assert Gains(1.0, 1.0, machine=1.5, start_s=0.0).asked(2) == pytest.approx(1.35)


def test_workers_are_not_asked_for_more_than_nine_tenths_of_their_number():
    assert Gains(1.0, 1.0, machine=2.4, start_s=0.0).asked(2) == pytest.approx(1.8)


def test_each_gain_is_a_median_of_its_own():
    rounds = [Gains(1.0, 9.0, 5.0, 3.0), Gains(2.0, 8.0, 4.0, 1.0), Gains(3.0, 7.0, 6.0, 2.0)]
    assert medians(rounds) == Gains(2.0, 8.0, 5.0, 2.0)
