"""The benchmark of situations counts what findings have right, and repeats its figures."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import situations as benchmark
from benchmarks.true_campaigns import TrueStep
from benchmarks.truths import PlannedShots, Situation
from campaigns.identification.findings import Finding

PLANNED = PlannedShots(np.zeros((20, 4)), np.zeros((20, 4)), ("identification",) * 20, (None,) * 20)
ENCODER = TrueStep("encoder 1", 10, 20, 0.05, {}, np.zeros(3))
STAND = TrueStep("frame", 10, 20, 0.3, {}, np.zeros(3))


def change(part, before_shot, size, says="arm 1's encoder or arm 1's forearm changed"):
    numbers = {"part": part, "before_shot": float(before_shot), "size": size, "U": 0.01}
    return Finding("change", says, "fail", numbers)


@pytest.mark.parametrize(
    ("finding", "rightly", "label"),
    [
        (change("encoder 1", 11, 0.055), (True, True, True), "change encoder!"),
        (change("encoder 1", 14, 0.07), (True, False, False), "change encoder!"),
        (change("forearm 1", 10, 0.05), (True, True, False), "change forearm~"),
        (change("mount 2", 10, 0.05, "arm 2's mount changed"), (False, False, False),
         "change mount?"),
        (Finding("scatter", "much", "fail"), (False, False, False), "scatter"),
    ],
)  # fmt: skip
def test_a_step_is_compared_with_the_finding(finding, rightly, label):
    assert benchmark.named_rightly(ENCODER, [finding], PLANNED) == rightly
    assert benchmark.label(finding, [ENCODER]) == label


@pytest.mark.parametrize(
    ("size", "is_right"), [(-0.2, True), (0.3, True), (0.1, False), (0.4, False)]
)
def test_of_a_motion_the_largest_share_along_an_axis_counts(size, is_right):
    finding = change("frame", 10, size, "the tracker's stand or the robot's base changed")
    assert benchmark.named_rightly(STAND, [finding], PLANNED).size == is_right


def test_the_best_finding_counts():
    findings = [change("encoder 1", 11, 0.05), change("encoder 1", 18, 0.01)]
    assert benchmark.named_rightly(ENCODER, findings, PLANNED) == (True, True, True)


def test_numbers_of_shots_are_read_from_sentences():
    says = "left out: shots 3, 17 contradict all others, by 0.1 mm; 20 % are no single mistakes"
    assert benchmark.shots_named([says, "measure shot 5 again"]) == {3, 5, 17}
    assert benchmark.shots_named(["the robot is as it was (χ² 12.0 of 18, p = 0.8)"]) == set()


def test_a_check_is_right_by_its_part_or_its_shots():
    measured = SimpleNamespace(steps=[ENCODER], wrong=frozenset())

    def text(decision, says="", parts=(), wrong=frozenset()):
        outcome = SimpleNamespace(decision=decision, says=says, parts=parts)
        return benchmark.check_label(outcome, replace_wrong(measured, wrong))

    assert text("fail", parts=("forearm 1", "encoder 1")) == "fail part!"
    assert text("fail", parts=("mount 1",)) == "fail arm!"
    assert text("fail", parts=("mount 2",)) == "fail part?"
    assert text("not decided", "measure shot 4 again", wrong=frozenset({4})) == "not decided shots!"
    assert text("not decided", "measure shot 5 again", wrong=frozenset({4})) == "not decided shots?"
    assert text("pass") == "pass"


def replace_wrong(measured, wrong):
    return SimpleNamespace(steps=measured.steps, wrong=wrong)


def test_every_listed_situation_has_a_meaning():
    for words in (*benchmark.KEY_CELLS, *benchmark.MORE_CELLS, *benchmark.CHECKS):
        assert Situation.parse(words).terms
    assert [*benchmark.chosen(["ripple o*", "rods 0.7"])] == [
        "ripple own",
        "ripple one",
        "rods 0.7",
    ]


@pytest.mark.slow
def test_campaigns_repeat_their_figures_and_wrong_shots_are_counted(tmp_path):
    first, again = (
        replace(benchmark.run("delta", "wrong 6 x 1.5", 30, 2, tmp_path), seconds=0.0)
        for _ in range(2)
    )
    assert first == again
    assert first.wrong == first.found == 3
    assert first.lost == 0
    assert "3/3" in benchmark.line([first])
    assert first.real_um < benchmark.WRONG_POSITIONS * first.stated_um


@pytest.mark.slow
def test_a_robot_that_is_as_it_was_passes_its_checks_and_a_step_does_not(tmp_path):
    cells = ("clean", "encoder 0.05 from 0")
    came = benchmark.judge_checks("delta", 60, 1, tmp_path, cells)
    assert came["clean"] == "pass"
    assert came["encoder 0.05 from 0"] == "fail part!"
