"""Optimal designs: the bookkeeping of exchanges, what they reach, and what they refuse."""

from itertools import combinations, product

import numpy as np
import pytest
from design_cases import anything, isotropic, shot_candidates, shots
from hypothesis import given
from hypothesis import strategies as st
from par4_space import SPACE

from campaigns.design import exchange
from campaigns.design.criteria import Criterion, inverse_of_one_plus
from campaigns.design.exchange import (
    RankKUpdater,
    Unobservable,
    augment_design,
    augment_quickly,
    minimum_measurements,
    optimal_design,
)
from campaigns.design.sample_size import evaluate
from campaigns.estimation.information import covariance


@pytest.fixture(scope="module")
def robot_shots():
    return shots()


def rng(seed=0):
    return np.random.default_rng(seed)


def value_of(candidates, criterion, chosen):
    return criterion.value(np.linalg.inv(candidates.information(np.asarray(chosen))))


def assert_same(one, other):
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(
        one.predicted_covariance, other.predicted_covariance, rtol=1e-8, atol=1e-10
    )
    np.testing.assert_allclose(one.sensitivity, other.sensitivity, rtol=1e-8, atol=1e-10)


@given(st.integers(1, 3), st.integers(2, 6), st.integers(0, 1000))
def test_updated_statistics_are_those_made_anew(k, unknowns, seed):
    candidates = anything(12, k, unknowns, seed)
    weight = np.cov(rng(seed).standard_normal((unknowns, 20)))
    updater = RankKUpdater.of(candidates, weight)

    def anew(chosen):
        information = np.eye(unknowns) + candidates.information(np.array(chosen))
        return updater.evaluate(np.linalg.inv(information))

    known = anew([0, 1, 2])
    assert_same(updater.added(known, 7), anew([0, 1, 2, 7]))
    assert_same(updater.removed(known, 1), anew([0, 2]))
    np.testing.assert_allclose(
        updater.covariance_with(known, 7), anew([0, 1, 2, 7]).covariance, atol=1e-10
    )


@given(st.integers(1, 4), st.integers(0, 1000))
def test_inverse_of_all_candidates_at_once(k, seed):
    roots = rng(seed).standard_normal((5, k, k))
    spread = roots @ roots.transpose(0, 2, 1)
    inverse = inverse_of_one_plus(spread.transpose(1, 2, 0))
    whole = np.eye(k) + spread
    np.testing.assert_allclose(inverse.transpose(2, 0, 1), np.linalg.inv(whole), atol=1e-10)


@pytest.mark.slow
def test_small_design_is_the_best_of_all():
    candidates = anything(10, 1, 3, seed=1, parameters=2)
    criterion = Criterion.of(candidates, rng(1).standard_normal((6, 3, 3)))
    found = optimal_design(candidates, criterion, 5, rng(), starts=20)
    every = [value_of(candidates, criterion, c) for c in combinations(range(10), 5)]
    assert value_of(candidates, criterion, found.chosen) == pytest.approx(min(every))


@pytest.mark.slow
def test_no_candidate_is_chosen_twice(robot_shots):
    case = robot_shots
    criterion = case.criterion
    chosen = optimal_design(case.candidates, criterion, 120, rng(), starts=1).chosen
    assert len(set(chosen.tolist())) == 120


def test_all_candidates_are_taken_when_so_many_are_asked_for():
    candidates = anything(9, 1, 3, seed=1)
    chosen = optimal_design(candidates, Criterion.of(candidates, np.ones((1, 3, 3))), 9, rng())
    assert sorted(chosen.chosen.tolist()) == list(range(9))


@pytest.mark.slow
def test_i_optimal_shots_tell_what_the_model_page_promises():
    count, length_mm, angle_deg = 40, 0.024, 0.0020
    case = shots(4000)
    criterion = case.criterion
    chosen = optimal_design(case.candidates, criterion, count, rng(), starts=1).chosen
    is_angle = SPACE.is_angle[SPACE.places(SPACE.free_by_default)]
    std = np.sqrt(np.diag(covariance(case.candidates.jacobian(chosen))))[: len(is_angle)]
    assert std[~is_angle].max() <= length_mm
    assert np.degrees(std[is_angle].max()) <= angle_deg


@pytest.mark.slow
def test_design_heeds_where_the_tracker_is_bad():
    """Chosen for a tracker that hardly sees x, shots beat those chosen for an even one."""
    blind = np.broadcast_to(np.diag([0.2**2, 0.01**2, 0.01**2]), (600, 3, 3))
    even, uneven = shots(), shots(noise=blind)

    def chosen_for(case):
        return optimal_design(case.candidates, case.criterion, 30, rng(), starts=1).chosen

    judge = uneven.criterion
    values = [value_of(uneven.candidates, judge, chosen_for(case)) for case in (even, uneven)]
    assert values[1] < 0.97 * values[0]


@pytest.mark.slow
def test_growing_a_design_makes_it_better(robot_shots):
    case = robot_shots
    criterion = case.criterion
    small = optimal_design(case.candidates, criterion, 20, rng(), starts=1)
    large = augment_design(case.candidates, criterion, small.chosen, 40)
    assert len(set(large.chosen.tolist())) == 40
    assert large.value < 0.6 * small.value


def test_thirteen_shots_are_the_fewest_that_tell_all(robot_shots):
    """Ten would give thirty equations for 28 unknowns, but no full rank."""
    assert minimum_measurements(robot_shots.candidates) == 13


@pytest.mark.slow
def test_design_of_the_fewest_shots_tells_all(robot_shots):
    case = robot_shots
    criterion = case.criterion
    chosen = optimal_design(case.candidates, criterion, 13, rng(), starts=1).chosen
    assert np.isfinite(evaluate(case.candidates, chosen).worst_length_mm)


@pytest.mark.parametrize(
    ("count", "said"),
    [
        (12, r"12 measurements .* 13 or more are needed"),
        (601, "601 measurements to choose, but only 600 candidates"),
    ],
)
def test_fewer_shots_than_tell_all_and_more_than_candidates_are_refused(robot_shots, count, said):
    case = robot_shots
    with pytest.raises(ValueError, match=said):
        optimal_design(case.candidates, case.criterion, count, rng())


def test_parameters_that_move_with_the_frame_are_named(robot_shots):
    """With the first motor free, nothing says where the robot's own frame is."""
    free = (*SPACE.free_by_default, "arm0.z_mm")
    case = robot_shots
    candidates = shot_candidates(free, case.joints, case.poses, isotropic(len(case.poses)))
    with pytest.raises(Unobservable, match=r"arm0\.z_mm"):
        minimum_measurements(candidates)


@pytest.mark.slow
def test_short_list_costs_next_to_nothing_of_what_all_candidates_give(monkeypatch):
    case = shots(1000)
    criterion = case.criterion
    listed = optimal_design(case.candidates, criterion, 40, rng(), starts=1)
    monkeypatch.setattr(exchange, "SHORT_LIST", len(case.candidates))
    thorough = optimal_design(case.candidates, criterion, 40, rng(), starts=1)
    assert listed.value <= 1.02 * thorough.value


def test_end_of_an_exchange_heeds_all_candidates(robot_shots, monkeypatch):
    """With a list of almost nothing, a choice that no single exchange improves is still found."""
    monkeypatch.setattr(exchange, "SHORT_LIST", 1)
    candidates = robot_shots.candidates
    criterion = robot_shots.criterion
    found = optimal_design(candidates, criterion, 14, rng(), starts=1).chosen
    value = value_of(candidates, criterion, found)
    for member, other in product(range(14), np.setdiff1d(np.arange(len(candidates)), found)):
        exchanged = found.copy()
        exchanged[member] = other
        assert value_of(candidates, criterion, exchanged) >= value * (1.0 - 1e-3)


@pytest.mark.slow
def test_quick_growth_is_a_few_percent_from_an_exchange(robot_shots):
    case = robot_shots
    criterion = case.criterion
    small = optimal_design(case.candidates, criterion, 14, rng(), starts=1).chosen
    quick = augment_quickly(case.candidates, criterion, small, 40)
    slow = augment_design(case.candidates, criterion, small, 40)
    assert len(set(quick.tolist())) == 40
    assert value_of(case.candidates, criterion, quick) <= 1.05 * slow.value
