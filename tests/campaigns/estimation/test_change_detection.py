"""Change tests on plain matrices: false alarms as stated, more told than by Bonferroni."""

from dataclasses import replace

import numpy as np
import pytest

from campaigns.estimation import change_detection
from campaigns.estimation.change_detection import (
    SIGNIFICANCE,
    Cause,
    detect_change,
    last_together,
    memory,
    without_memory,
)
from campaigns.estimation.f_test import FittedShots, log_p

SHOTS, UNKNOWNS, SIDES = 40, 8, 3
RNG = np.random.default_rng(3)
JACOBIAN = RNG.standard_normal((SHOTS, 3, UNKNOWNS))
CAUSES = tuple(
    Cause("length", f"arm{arm}.arm_mm", RNG.standard_normal((SHOTS, 3, 1))) for arm in range(4)
)
FRAME = Cause("frame", "frame", RNG.standard_normal((SHOTS, 3, 6)))


def residual(seed):
    return np.random.default_rng([7, seed]).standard_normal((SHOTS, 3))


def found_of(shifted, causes, jacobian=JACOBIAN):
    return detect_change(FittedShots.of(shifted, jacobian), causes)


def stepped(seed, size, after=20):
    """Good shots, and a step of the second cause."""
    shifted = residual(seed)
    shifted[after:] -= size * CAUSES[1].columns[after:, :, 0]
    return shifted


@pytest.fixture
def always_told(monkeypatch):
    monkeypatch.setattr(change_detection, "SIGNIFICANCE", np.inf)


def test_a_step_is_told_with_cause_place_and_size():
    found = found_of(stepped(1, 2.0), (*CAUSES, FRAME))
    assert (found.kind, found.name) == ("length", "arm1.arm_mm")
    assert abs(found.after - 19) <= 1
    assert found.size[0] == pytest.approx(2.0, abs=5.0 * found.std[0])
    assert found.p < SIGNIFICANCE


def test_a_drift_is_told_with_its_size():
    drift = Cause("drift", "lengths", CAUSES[1].columns)
    passed = np.linspace(0.0, 1.0, SHOTS)
    shifted = residual(2) - 5.0 * passed[:, None] * CAUSES[1].columns[:, :, 0]
    found = found_of(shifted, (*CAUSES, FRAME, drift))
    assert (found.kind, found.name) == ("drift", "lengths")
    assert found.size[0] == pytest.approx(5.0, abs=5.0 * found.std[0])


def test_good_shots_show_no_change():
    drift = Cause("drift", "lengths", CAUSES[1].columns)
    for seed in range(30):
        assert found_of(residual(seed), (*CAUSES, FRAME, drift)) is None


@pytest.mark.slow
@pytest.mark.long
def test_stated_chance_is_no_smaller_than_the_real_one(always_told):
    told = [found_of(residual(seed), CAUSES) for seed in range(1500)]
    for level in (0.02, 0.1, 0.3):
        spread = np.sqrt(level / len(told))
        assert (
            np.mean([each is not None and each.p < level for each in told]) < level + 3.0 * spread
        )


def test_neighbouring_places_do_not_count_as_tests_of_their_own(always_told):
    """A step from k on and one from k + 1 on are almost the same test."""
    places = SHOTS - 2 * change_detection.FEWEST_BEYOND + 1
    found = found_of(stepped(1, 0.7), CAUSES[1:2])
    square, freedom = (found.size[0] / found.std[0]) ** 2, 3 * SHOTS - UNKNOWNS
    chi2 = freedom - 1 + square
    alone = np.exp(log_p(1, freedom, square, chi2))
    assert alone < found.p < 0.8 * places * alone


def test_a_frames_six_columns_count_at_every_place(always_told):
    found = found_of(residual(3), (FRAME,))
    assert 0.0 < found.p <= 1.0


def test_one_gross_error_makes_no_step_and_hides_none():
    for row in (2, 20, SHOTS - 3, SHOTS - 2):
        wrong = residual(5)
        wrong[row] += 18.0
        assert found_of(wrong, (*CAUSES, FRAME)) is None
    shifted = stepped(1, 2.0)
    shifted[-3] += 15.0
    assert found_of(shifted, (*CAUSES, FRAME)).name == "arm1.arm_mm"


@pytest.mark.parametrize("rows", [[9, 10], [19, 20], [28, 29]])
def test_two_gross_errors_side_by_side_make_no_step(rows):
    wrong = residual(6)
    wrong[rows] += [[30.0, -20.0, 10.0], [-25.0, 5.0, 40.0]]
    known = np.concatenate([JACOBIAN, *(each.columns for each in (*CAUSES, FRAME))], axis=2)
    assert found_of(wrong, (*CAUSES, FRAME), known) is None
    assert found_of(stepped(1, 2.0), (*CAUSES, FRAME), known).name == "arm1.arm_mm"


def test_what_is_put_back_is_no_step():
    """A step holds for all shots after it."""
    passing = stepped(1, 3.0, after=12)
    passing[20:] += 3.0 * CAUSES[1].columns[20:, :, 0]
    assert found_of(passing, CAUSES) is None


@pytest.mark.parametrize("after", [SHOTS - 3, SHOTS - 5])
def test_a_step_before_the_last_three_shots_is_told(after):
    found = found_of(stepped(2, 10.0, after), (*CAUSES, FRAME))
    assert (found.name, found.after) == ("arm1.arm_mm", after - 1)


def test_what_nothing_tells_has_no_size_where_other_places_tell_everything():
    normal = np.array([np.diag([4.0, 2.0]), np.ones((2, 2)), np.zeros((2, 2))])
    expected = [np.diag([0.25, 0.5]), np.full((2, 2), 0.25), np.zeros((2, 2))]
    gained, gains = np.array([[2.0, 2.0]] * 3), [3.0, 4.0, 0.0]
    for rows in ([0], [1], [0, 1, 2]):
        assert change_detection._inverse(normal[rows]) == pytest.approx(np.array(expected)[rows])
        found = change_detection._gains(normal[rows], gained[rows])
        assert found == pytest.approx(np.array(gains)[rows])


def test_shots_that_hardly_show_a_step_do_not_speak_against_it():
    weak = CAUSES[1].columns.copy()
    weak[-3:] *= 0.05
    shifted = residual(4)
    shifted[-5:] -= 6.0 * weak[-5:, :, 0]
    against = weak[-3:, :, 0] / np.linalg.norm(weak[-3:, :, 0])
    shifted[-3:] = 1.8 * against - 6.0 * weak[-3:, :, 0]
    found = found_of(shifted, (CAUSES[0], Cause("joint", "arm1", weak), FRAME))
    assert (found.name, found.after) == ("arm1", SHOTS - 6)


def test_of_causes_that_shots_hardly_tell_apart_the_more_frequent_is_named():
    alike = CAUSES[1].columns + 0.02 * RNG.standard_normal((SHOTS, 3, 1))
    causes = (*CAUSES, Cause("joint", "slipped", alike, 0.0))
    rare = tuple(replace(each, log_prior=-5.0) for each in CAUSES)
    assert found_of(stepped(1, 3.0, SHOTS - 4), causes).name == "arm1.arm_mm"
    assert found_of(stepped(1, 3.0, SHOTS - 4), (*rare, causes[-1])).name == "slipped"
    assert found_of(stepped(1, 3.0, SHOTS - 4), rare).name == "arm1.arm_mm"


def remembering(seed, shots=150, memory_of=0.9):
    """Noise with memory, of unit variance."""
    white = np.random.default_rng([9, seed]).standard_normal((shots, 3))
    for row in range(1, shots):
        white[row] = memory_of * white[row - 1] + np.sqrt(1.0 - memory_of**2) * white[row]
    return white


def test_memory_of_noise_is_found_and_taken_out():
    plain = [remembering(seed, memory_of=0.0) for seed in range(60)]
    assert np.mean([len(memory(each)) > 0 for each in plain]) < 0.12
    found = memory(remembering(1))
    assert -found[1:].sum() / found[0] == pytest.approx(0.95, abs=0.05)
    left = without_memory(found, remembering(1))
    assert abs(np.sum(left[1:] * left[:-1])) < 0.2 * np.sum(left**2)
    assert np.array_equal(without_memory(memory(plain[0]), plain[1]), plain[1])


def test_wrong_shots_together_at_the_end_are_no_chance_and_others_are():
    wrong = np.zeros(100, dtype=bool)
    wrong[[93, 95, 96, 99]] = True
    assert last_together(wrong) == 93
    wrong[40] = True
    assert last_together(wrong) is None
    assert last_together(np.eye(100, dtype=bool)[99]) is None
