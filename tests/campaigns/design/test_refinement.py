"""Refinement beyond the candidates: a better design, of poses that can be taken and seen."""

import numpy as np
import pytest
from design_cases import isotropic, rows_at, shots
from par4_cases import CENTRE, region

from campaigns.design.exchange import EXCHANGE_REGULARISATION, covariance_of, optimal_design
from campaigns.design.refinement import refine
from campaigns.estimation.information import whitened

SEEN = region(acceptance_rad=np.radians(8.0))
CASE = shots(300)
COUNT = 14


def jacobians(poses):
    flat = poses.reshape(-1, poses.shape[-1])
    return whitened(rows_at(flat), isotropic(len(flat))) / CASE.candidates.scale


def value(poses, criterion):
    found = covariance_of(CASE.candidates, jacobians(poses), EXCHANGE_REGULARISATION)
    return criterion.value(found)


@pytest.mark.parametrize("name", ["I", "D", "A", "E"])
def test_refined_design_tells_more_than_the_best_choice_among_the_candidates(name):
    criterion, place = CASE.criterion(name), region()
    chosen = optimal_design(CASE.candidates, criterion, COUNT, np.random.default_rng(1), starts=2)
    start = CASE.poses[chosen.chosen][:, None]

    def refined():
        rng = np.random.default_rng(2)
        known = CASE.candidates, CASE.poses[:, None], criterion
        return refine(start, place, jacobians, *known, 8, rng)

    found = refined()
    assert value(start, criterion) == pytest.approx(chosen.value)
    assert value(found, criterion) < 0.95 * chosen.value
    assert place.allows(found[:, 0]).all()
    np.testing.assert_array_equal(found, refined())


def test_poses_beyond_the_boundary_are_drawn_in_to_it_and_others_stay():
    rng = np.random.default_rng(1)
    poses = CENTRE + rng.uniform(-1.0, 1.0, (2000, len(CENTRE))) * SEEN.extent
    inside = SEEN.allows(poses)
    moved, allowed = SEEN.drawn_in(poses)
    np.testing.assert_array_equal(moved[inside], poses[inside])
    assert allowed[inside].all()
    drawn = allowed & ~inside
    assert drawn.sum() > 100
    assert SEEN.allows(moved[drawn]).all()
    further_out = moved[drawn] + 0.6 * (poses - moved)[drawn]
    assert not SEEN.allows(further_out).any()
