"""The least number of measurements that meets a goal."""

import numpy as np
import pytest
from design_cases import anything, shots

from campaigns.design.exchange import optimal_design
from campaigns.design.sample_size import (
    GoalOutOfReach,
    curve_counts,
    design_curve,
    diminishing_returns_from,
    evaluate,
    minimal_design,
)


@pytest.fixture(scope="module")
def case():
    return shots(300)


@pytest.fixture(scope="module")
def criterion(case):
    return case.criterion


def rng():
    return np.random.default_rng(3)


def point(case, criterion, count):
    return next(design_curve(case.candidates, criterion, [count], rng()))


def test_found_number_meets_the_goal_and_is_not_much_too_large(case, criterion):
    found = minimal_design(case.candidates, criterion, 0.03, 200, 2, rng())
    assert evaluate(case.candidates, found.chosen).worst_length_mm == found.worst_length_mm <= 0.03
    assert found.count % 2 == 0
    fewer = optimal_design(case.candidates, criterion, found.count - 6, rng(), starts=2)
    assert evaluate(case.candidates, fewer.chosen).worst_length_mm > 0.03


def test_a_goal_takes_the_fewest_shots_or_any_number_up_to_the_largest(case, criterion):
    found = minimal_design(case.candidates, criterion, 1.0, 200, 2, rng())
    assert found.count == 14
    best_mm = point(case, criterion, 30).worst_length_mm
    found = minimal_design(case.candidates, criterion, 1.02 * best_mm, 30, 2, rng())
    assert 26 <= found.count <= 30


def test_goal_out_of_reach_says_what_can_be_had(case, criterion):
    with pytest.raises(
        GoalOutOfReach, match=r"40 measurements give σ 0\.02.*goal 0\.001 mm"
    ) as told:
        minimal_design(case.candidates, criterion, 0.001, 40, 2, rng())
    assert told.value.best.worst_length_mm == pytest.approx(0.025, rel=0.1)


def test_curve_falls_and_is_nearly_that_of_designs_made_for_each_number(case, criterion):
    curve = list(design_curve(case.candidates, criterion, [14, 28, 56, 112], rng()))
    assert [point.count for point in curve] == [14, 28, 56, 112]
    lengths = [point.worst_length_mm for point in curve]
    assert lengths == sorted(lengths, reverse=True)
    assert diminishing_returns_from([14, 28, 56, 112], lengths) in {28, 56}
    alone = [point(case, criterion, count).worst_length_mm for count in (28, 112)]
    assert [lengths[1], lengths[3]] == pytest.approx(alone, rel=0.1)


@pytest.mark.parametrize("step", [1, 2])
def test_numbers_of_a_curve_are_whole_steps_up_to_the_most(step):
    counts = list(curve_counts(14, 240, step))
    assert counts[0] == 14
    assert counts == sorted(set(counts))
    assert 170 < counts[-1] <= 240
    assert all(count % step == 0 for count in counts)


def test_pure_averaging_is_seen_from_the_start():
    assert diminishing_returns_from([10, 20, 40], [count**-0.5 for count in (10, 20, 40)]) == 10
    assert (
        diminishing_returns_from([5, 10, 20, 40], [1.0, *(count**-0.5 for count in (10, 20, 40))])
        == 10
    )


def test_the_worst_length_is_sought_among_lengths():
    candidates = anything(50, 1, 3, seed=2)
    renamed = type(candidates)(
        candidates.jacobians,
        np.array([1.0, 10.0, 1.0]),
        ("a_mm", "b_mm", "c_deg"),
        np.array([True, True, False]),
        candidates.mean_information,
    )
    everything = np.arange(50)
    std = np.sqrt(
        np.diag(np.linalg.inv(renamed.jacobian(everything).T @ renamed.jacobian(everything)))
    )
    assert evaluate(renamed, everything).worst_length_mm == pytest.approx(max(std[:2]))
