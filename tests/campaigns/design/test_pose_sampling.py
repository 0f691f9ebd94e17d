"""Where to measure: feasible, seen, near the boundary; pairs long enough, with little travel."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from par4_cases import CENTRE, LIMITS, NOMINAL, TRACKER_MM, region

from campaigns.design import pose_sampling
from campaigns.design.pose_sampling import (
    WorkspaceTooSmall,
    boundary_poses,
    incidence_rad,
    interior_poses,
    random_pairs,
)
from campaigns.design.tours import shortest_tour

SEEN = region(acceptance_rad=np.radians(8.0))
FACING = SEEN.reflector_facing


def rng(seed=0):
    return np.random.default_rng(seed)


def lengths_mm(poses, pairs):
    return np.linalg.norm(poses[pairs[:, 1], :3] - poses[pairs[:, 0], :3], axis=1)


def whole_travel(joints, pairs, start):
    stops = np.vstack([start, joints[pairs.ravel()]])
    return float(np.abs(np.diff(stops, axis=0)).max(axis=1).sum())


@pytest.mark.parametrize("draw", [interior_poses, boundary_poses])
def test_every_pose_can_be_taken_and_seen(draw):
    poses = draw(SEEN, 200, rng())
    assert poses.shape == (200, 4)
    assert NOMINAL.feasibility(LIMITS, poses).feasible.all()
    assert incidence_rad(poses[:, :3], TRACKER_MM, FACING).max() <= np.radians(8.0)


def test_boundary_poses_are_at_the_boundary_of_what_is_seen_and_inner_ones_are_not():
    poses = interior_poses(region(), 500, rng())
    assert 0.5 < SEEN.allows(poses).mean() < 0.95
    poses = boundary_poses(SEEN, 200, rng())
    assert not SEEN.allows(CENTRE + 1.05 * (poses - CENTRE)).any()
    poses = interior_poses(SEEN, 400, rng())
    assert SEEN.allows(CENTRE + 1.05 * (poses - CENTRE)).mean() > 0.5


def test_a_workspace_too_small_says_how_much_was_found(monkeypatch):
    monkeypatch.setattr(pose_sampling, "BATCHES", 2)
    nowhere = region(limits=replace(LIMITS, joint=(0.5, 0.5)))
    with pytest.raises(WorkspaceTooSmall, match="0 of 8000 poses tried can be taken, 3 needed"):
        interior_poses(nowhere, 3, rng())


def test_incidence_is_the_angle_between_reflector_and_beam():
    tracker_mm = np.array([2000.0, 0.0, 0.0])
    points_mm = np.array([[0.0, 0, 0], [0, 2000, 0], [2000, 1000, 0], [4000, 0, 0]])
    angles = np.degrees(incidence_rad(points_mm, tracker_mm, np.array([1.0, 0.0, 0.0])))
    assert angles == pytest.approx([0.0, 45.0, 90.0, 180.0])


@given(st.integers(0, 2**32 - 1))
def test_pairs_use_every_pose_once_and_none_is_short(seed):
    spread_mm = np.full(4, 200.0)
    poses = rng(seed).uniform(-spread_mm, spread_mm, (40, 4))
    pairs = random_pairs(poses, rng(seed))
    assert sorted(pairs.ravel().tolist()) == list(range(40))
    assert lengths_mm(poses, pairs).min() >= 100.0


def test_pairs_go_across_clusters_and_are_made_of_short_ones_and_of_odd_numbers_too():
    """At random half of the pairs would be short."""
    poses = np.zeros((40, 4))
    poses[20:, 0] = 150.0
    pairs = random_pairs(poses, rng())
    assert (lengths_mm(poses, pairs) == 150.0).all()
    pairs = random_pairs(np.zeros((6, 4)), rng())
    assert sorted(pairs.ravel().tolist()) == list(range(6))
    poses = interior_poses(SEEN, 7, rng())
    assert random_pairs(poses, rng()).shape == (3, 2)


def test_the_order_keeps_pairs_together_and_shortens_the_travel():
    poses = boundary_poses(SEEN, 120, rng(8))
    joints = NOMINAL.inverse(poses).values_or_raise()
    start = NOMINAL.inverse(CENTRE[None]).values_or_raise()[0]
    pairs = random_pairs(poses, rng(8))
    ordered = shortest_tour(joints, pairs, start)
    assert {frozenset(pair) for pair in ordered.tolist()} == {
        frozenset(pair) for pair in pairs.tolist()
    }
    assert whole_travel(joints, ordered, start) < 0.75 * whole_travel(joints, pairs, start)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_a_tour_of_hardly_any_pairs(count):
    joints = rng().uniform(-0.7, 1.5, (4, 4))
    pairs = np.arange(2 * count).reshape(count, 2)
    assert shortest_tour(joints, pairs, joints[0]).shape == (count, 2)
