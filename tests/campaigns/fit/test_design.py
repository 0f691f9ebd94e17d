"""Choice of shots: each change against matrices that are formed anew."""

import numpy as np
import pytest

from campaigns.fit.design import ShotDesign

CANDIDATES, UNKNOWNS, POSITIONS = 12, 5, 7


def design(seed=1, chosen=(), rows=3):
    rng = np.random.default_rng(seed)
    jacobians = rng.normal(size=(CANDIDATES, rows, UNKNOWNS)) * rng.uniform(
        0.3, 3.0, (CANDIDATES, 1, 1)
    )
    root = rng.normal(size=(UNKNOWNS, UNKNOWNS))
    judged = rng.normal(size=(3 * POSITIONS, UNKNOWNS))
    prior = 0.1 * (root @ root.T + np.eye(UNKNOWNS))
    by_position = judged.reshape(POSITIONS, 3, UNKNOWNS)
    return ShotDesign(jacobians, prior, by_position, list(chosen)), judged


def covariance_of(shots, chosen):
    rows = shots.jacobians[list(chosen)].reshape(-1, UNKNOWNS)
    return np.linalg.inv(shots.prior + rows.T @ rows)


def std_mm(shots, judged, chosen):
    """Root of the mean variance of the judged positions, by a new inverse."""
    return np.sqrt(np.trace(judged @ covariance_of(shots, chosen) @ judged.T) / POSITIONS)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_added_shot_is_that_after_which_positions_are_least_uncertain(seed):
    shots, judged = design(seed)
    for number in range(5):
        free = [row for row in range(CANDIDATES) if row not in shots.chosen]
        best = min(free, key=lambda row: std_mm(shots, judged, [*shots.chosen, row]))
        assert shots.add_best() == best
        assert shots.chosen[-1] == best
        assert len(shots.chosen) == number + 1
        assert shots.covariance == pytest.approx(covariance_of(shots, shots.chosen))
        assert shots.position_std_mm == pytest.approx(std_mm(shots, judged, shots.chosen))


def test_a_design_begins_with_the_shots_that_it_is_given():
    shots, judged = design(chosen=(3, 8))
    assert shots.covariance == pytest.approx(covariance_of(shots, (3, 8)))
    assert shots.position_std_mm == pytest.approx(std_mm(shots, judged, (3, 8)))
    assert shots.add_best() not in (3, 8)


def test_shots_are_added_until_their_count_or_the_uncertainty_is_reached():
    shots, judged = design()
    shots.add_until(6)
    assert len(shots.chosen) == 6
    order = list(shots.chosen)
    limit = std_mm(shots, judged, order[:4])
    by_limit, _ = design()
    by_limit.add_until(6, limit * (1.0 + 1e-9))
    assert by_limit.chosen == order[:4]
    assert by_limit.covariance == pytest.approx(covariance_of(by_limit, order[:4]), rel=1e-12)


def test_no_shot_is_added_once_the_uncertainty_is_exactly_what_was_asked_for():
    shots, _ = design()
    for _ in range(3):
        shots.add_best()
    same, _ = design()
    same.add_until(6, shots.position_std_mm)
    assert same.chosen == shots.chosen


def exchanged(shots, judged, chosen, rounds=3):
    """Exchange of one shot after the other, each by trying all candidates."""
    chosen = list(chosen)
    for _ in range(rounds):
        before = set(chosen)
        for shot in list(chosen):
            chosen.remove(shot)
            free = [row for row in range(CANDIDATES) if row not in chosen]
            chosen.append(min(free, key=lambda row: std_mm(shots, judged, [*chosen, row])))
        if set(chosen) == before:
            break
    return chosen


@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5, 6])
def test_exchange_is_that_by_trying_all_candidates(seed):
    shots, judged = design(seed, chosen=(0, 1, 2, 3))
    before_mm = shots.position_std_mm
    expected = exchanged(shots, judged, (0, 1, 2, 3))
    shots.exchange()
    assert shots.chosen == expected
    assert shots.position_std_mm == pytest.approx(std_mm(shots, judged, expected))
    assert shots.position_std_mm < before_mm
    assert shots.covariance == pytest.approx(covariance_of(shots, expected), rel=1e-12)


@pytest.mark.parametrize("rows", [1, 6])
def test_observations_of_any_number_of_rows_are_chosen_alike(rows):
    shots, judged = design(2, rows=rows)
    shots.add_until(4)
    expected = exchanged(shots, judged, shots.chosen)
    shots.exchange()
    assert shots.chosen == expected
    assert shots.covariance == pytest.approx(covariance_of(shots, expected), rel=1e-12)


def test_an_exchange_never_takes_a_shot_twice():
    shots, _ = design(chosen=range(CANDIDATES - 1))
    shots.exchange()
    assert len({*shots.chosen}) == CANDIDATES - 1
