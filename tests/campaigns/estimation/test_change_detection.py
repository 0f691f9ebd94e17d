"""Change tests on plain matrices: false alarms as stated, more told than by Bonferroni."""

import numpy as np
import pytest

from campaigns.estimation import change_detection
from campaigns.estimation.change_detection import SIGNIFICANCE, Cause, detect_change

SHOTS, UNKNOWNS, SIDES = 40, 8, 3
RNG = np.random.default_rng(3)
JACOBIAN = RNG.standard_normal((SHOTS, 3, UNKNOWNS))
ROOT = np.broadcast_to(np.eye(3), (SHOTS, 3, 3))
CAUSES = tuple(
    Cause("length", f"arm{arm}.arm_mm", RNG.standard_normal((SHOTS, 3, 1))) for arm in range(4)
)
FRAME = Cause("frame", "frame", RNG.standard_normal((SHOTS, 3, 6)))


def residual(seed):
    return np.random.default_rng([7, seed]).standard_normal((SHOTS, 3))


def stepped(seed, size, after=20):
    """Good shots, and a step of the second cause."""
    shifted = residual(seed)
    shifted[after:] -= size * CAUSES[1].columns[after:, :, 0]
    return shifted


@pytest.fixture
def always_told(monkeypatch):
    monkeypatch.setattr(change_detection, "SIGNIFICANCE", np.inf)


def test_a_step_is_told_with_cause_place_and_size():
    found = detect_change(stepped(1, 2.0), JACOBIAN, (*CAUSES, FRAME), ROOT)
    assert (found.kind, found.name) == ("length", "arm1.arm_mm")
    assert abs(found.after - 19) <= 1
    assert found.size[0] == pytest.approx(2.0, abs=5.0 * found.std[0])
    assert found.p < SIGNIFICANCE


def test_good_shots_show_no_change():
    for seed in range(30):
        assert detect_change(residual(seed), JACOBIAN, (*CAUSES, FRAME), ROOT) is None


@pytest.mark.slow
@pytest.mark.long
def test_stated_chance_is_no_smaller_than_the_real_one(always_told):
    told = [detect_change(residual(seed), JACOBIAN, CAUSES, ROOT).p for seed in range(1500)]
    for level in (0.02, 0.1, 0.3):
        spread = np.sqrt(level / len(told))
        assert np.mean(np.array(told) < level) < level + 3.0 * spread


def test_neighbouring_places_do_not_count_as_tests_of_their_own(always_told):
    """A step from k on and one from k + 1 on are almost the same test."""
    places = SHOTS - 2 * change_detection.FEWEST_BEYOND + 1
    found = detect_change(stepped(1, 0.7), JACOBIAN, CAUSES[1:2], ROOT)
    rest = (found.size[0] / found.std[0]) ** 2
    alone = change_detection.fdtrc(1, 3 * SHOTS - UNKNOWNS - 1, rest)
    assert alone < found.p < 0.8 * places * alone


def test_a_frames_six_columns_count_at_every_place(always_told):
    found = detect_change(residual(3), JACOBIAN, (FRAME,), ROOT)
    assert 0.0 < found.p <= 1.0
