"""Captions: each says what its figure shows, of data that are made to show it."""

import numpy as np
import pytest

from app.report import captions
from app.report.groups import PairGroup
from campaigns.estimation.information import Uncertainty
from campaigns.evaluation.model_errors import PositionErrors
from campaigns.evaluation.time_series import TimeSeries
from campaigns.evaluation.validation import (
    LineTest,
    MeasuredLength,
    RepeatabilityTest,
    RotationTest,
    ValidationResult,
)

RANDOM = np.random.default_rng(7)
POSES = np.column_stack([RANDOM.uniform(-300.0, 300.0, (80, 3)), RANDOM.uniform(-0.6, 0.6, 80)])
NOISE = RANDOM.normal(0.0, 0.05, (80, 3))
NUMBERS = tuple(range(101, 181))
LENGTH = MeasuredLength(0.3, 0.01)


def positions(after: np.ndarray) -> PositionErrors:
    field = 0.01 * POSES[:, [1, 0, 2]]
    fitted, tilt = np.ones(80, dtype=bool), 1e-5 * POSES[:, :3]
    return PositionErrors(POSES, field, after, fitted, tilt, NUMBERS)


def result(lines: tuple[LineTest, ...]) -> ValidationResult:
    return ValidationResult(None, None, None, lines, None)


def test_the_largest_error_has_its_shot_its_place_and_what_it_follows() -> None:
    errors = NOISE.copy()
    errors[30] *= 3.0 / np.linalg.norm(errors[30])
    told = captions.places_in_words(positions(errors))
    assert told.startswith("The largest is 3.000 mm at shot 131, ")
    assert "no trend with radius or x or y or z or angle (p = " in told
    grown = NOISE / np.linalg.norm(NOISE, axis=1)[:, None] * (400.0 + POSES[:, :1]) / 1000.0
    told = captions.places_in_words(positions(grown))
    assert f"at shot {NUMBERS[POSES[:, 0].argmax()]}, near the edge of the workspace" in told
    assert "it follows x (+1.00, p < 0.001)." in told


def test_arrows_of_neighbours_that_agree_are_told_from_noise() -> None:
    told = captions.arrows_in_words(positions(NOISE))
    assert told.startswith("Before, neighbours agree (mean cosine 0.")
    assert "; after, neighbours do not agree (mean cosine " in told


def test_a_shot_that_stands_out_is_named() -> None:
    lengths = np.linalg.norm(NOISE, axis=1)
    group = PairGroup("fitted shots", "o", lengths, lengths, NUMBERS)
    assert "none stands out (p = " in captions.shots_in_words(group)
    lengths = lengths.copy()
    lengths[4] = 9.0
    told = captions.shots_in_words(PairGroup("fitted shots", "o", None, lengths, NUMBERS))
    assert "The largest after is 9.000 mm at shot 105, " in told
    assert "it stands out (p < 0.001); no trend with the order of shots" in told


def test_pairs_are_told_by_rms_and_the_largest_with_its_number() -> None:
    fitted = PairGroup("fitted pairs", "o", np.array([3.0, -4.0]), np.array([0.3, -0.4]), (5, 6))
    unseen = PairGroup("hold-out pairs", "D", np.array([1.0]), np.array([-0.9]))
    assert captions.pairs_in_words([fitted, unseen]) == (
        "Rms after: fitted pairs 0.354 mm, hold-out pairs 0.900 mm; "
        "the largest is 0.900 mm at mark 1 (hold-out pairs)."
    )
    assert "Rms after: fitted pairs 0.354 mm; the largest is 0.400 mm at pair 6" in (
        captions.pairs_in_words([fitted])
    )


def test_errors_that_lean_are_told_from_errors_about_zero() -> None:
    group = PairGroup("fitted pairs", "o", NOISE[:, 0] + 5.0, NOISE[:, 0] - NOISE[:, 0].mean())
    told = captions.spread_in_words([group])
    assert told.startswith("Before they are not centred on zero: mean +")
    assert told.endswith("; after they are centred on zero: mean 0.000 mm (p = 1).")


def test_lines_rotation_and_visits_say_in_which_direction() -> None:
    along = np.column_stack([np.linspace(-400.0, 400.0, 17), np.zeros((17, 2))])
    away = np.column_stack([np.zeros(17), 0.01 * np.ones(17), np.linspace(-0.3, 0.3, 17)])
    line = LineTest("x", along, along + away, away, LENGTH, in_base=True)
    assert captions.lines_in_words(None, result((line,))) == (
        "After, the worst line is off by 0.300 mm along x, most in z."
    )
    turned = captions.rotation_in_words(None, RotationTest(along[:, 0] / 500.0, away, LENGTH))
    assert turned == (
        "After, the point moves by 0.300 mm, most in z; "
        "it follows the angle in z (+1.00, p < 0.001)."
    )
    visits = RepeatabilityTest(np.zeros(3), NOISE * 2.0, LENGTH, 1e-6 * np.eye(3), in_base=True)
    told = captions.visits_in_words(None, visits)
    assert told.startswith("80 visits after, σ in mm: x 0.0")
    assert "times as far as the median" in told


def test_correlations_tilt_and_time_are_told() -> None:
    covariance = np.array([[1.0, -0.9, 0.0], [-0.9, 1.0, 0.0], [0.0, 0.0, 1.0]])
    known = Uncertainty.of(("a_mm", "b_mm", "c_mm"), np.ones(3), covariance)
    assert captions.correlations_in_words(known) == (
        "The strongest is −0.90, of a_mm with b_mm; 1 of 3 are beyond 0.7."
    )
    assert "it follows the distance from the middle (+" in captions.tilt_in_words(positions(NOISE))
    times = np.arange(8.0)
    course = TimeSeries("run", times, 20.0 + 0.1 * times, times, 0.01 * times)
    assert captions.time_in_words([course]) == (
        "Run: air 20.00 to 20.70 °C; run: the drift pose moved by 0.070 mm at most; "
        "it follows time (+1.00, p < 0.001)."
    )


@pytest.mark.parametrize("count", [1, 2, 4])
def test_few_values_show_no_pattern_and_break_nothing(count: int) -> None:
    few = np.linspace(0.1, 0.2, count)
    group = PairGroup("few", "o", few, few)
    assert "none stands out (p = 1); no trend with the order of shots (p = 1)" in (
        captions.shots_in_words(group)
    )
    assert "centred on zero" in captions.spread_in_words([group])
