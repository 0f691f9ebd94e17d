import numpy as np
import pytest

from benchmarks import against_rivals
from benchmarks.against_rivals import (
    COMPILED,
    LAB,
    LEAST_OF_LAB,
    OURS,
    SAME_PARAMETERS,
    UNSEEN_MM,
    compiled,
    contest,
    same_parameters,
    serial_arm,
    unseen_errors,
)
from benchmarks.rivals.pybotics_process import RivalMissing
from benchmarks.shared.measured_robot import measured_robot
from benchmarks.shared.prototype import FREE
from benchmarks.shared.rounds import Run

ANSWER = np.zeros(len(FREE))
TITLE = "60 distances"


def missed(seconds, answer=ANSWER, judge=same_parameters):
    contestants = {OURS: lambda: Run(1.0, ANSWER), LAB: lambda: Run(seconds, answer)}
    return contest(TITLE, contestants, 3, judge, LEAST_OF_LAB).missed


def test_ratio_below_what_is_asked_for_is_missed():
    assert missed(LEAST_OF_LAB) == []
    assert missed(899.0) == [f"{TITLE}, {LAB}: time"]


@pytest.mark.parametrize("off", [2.0 * SAME_PARAMETERS[0], np.nan])
def test_ratio_against_other_parameters_is_missed(off):
    answer = np.full(len(FREE), off)
    apart = [f"{TITLE}, {LAB}: {kind} apart" for kind in ("lengths", "angles")]
    assert missed(2.0 * LEAST_OF_LAB, answer) == apart


@pytest.mark.parametrize(("left_mm", "faults"), [(0.9 * UNSEEN_MM, 0), (1.1 * UNSEEN_MM, 1)])
def test_calibration_that_leaves_errors_on_unseen_points_is_missed(left_mm, faults):
    assert len(missed(LEAST_OF_LAB, left_mm, unseen_errors)) == faults


def test_compiled_program_has_to_find_the_same_minimum():
    contestants = {OURS: lambda: Run(1.0, ANSWER), COMPILED: lambda: Run(0.1, ANSWER + 2e-6)}
    report = contest(TITLE, contestants, 3, same_parameters)
    apart = [f"{TITLE}, {COMPILED}: {kind} apart" for kind in ("lengths", "angles")]
    assert report.missed == apart
    assert report.figures[-1].value == pytest.approx(10.0)


def test_without_a_compiler_one_line_says_so_and_the_others_go_on(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(against_rivals, "CACHE", tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert compiled("points", measured_robot()) == {}
    assert "points: not compared with C: " in capsys.readouterr().err


def test_without_pybotics_one_line_says_why_and_nothing_is_missed(monkeypatch):
    def no_network():
        raise RivalMissing("no network")

    monkeypatch.setattr(against_rivals, "command_line", no_network)
    report = serial_arm(measured_robot(), 1)
    assert str(report).strip().endswith("not compared, no network")
    assert report.missed == []
