"""Pairs worth a distance, and joints approached from both sides."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from par4_cases import CENTRE, NOMINAL, region

from campaigns.design import tours
from campaigns.design.pose_sampling import boundary_poses, interior_poses, random_pairs

START = NOMINAL.inverse(CENTRE[None]).values_or_raise()[0]


def placed(count, seed=4):
    """Joints and points all over the workspace and near its boundary."""
    rng, half = np.random.default_rng(seed), count // 2
    poses = np.vstack([draw(region(), half, rng) for draw in (interior_poses, boundary_poses)])
    return NOMINAL.inverse(poses).values_or_raise(), poses[:, :3]


def travel(joints, pairs):
    way = np.vstack([START, joints[pairs.ravel()]])
    return tours.travel_rad(way[:-1], way[1:]).sum()


def test_share_counts_approaches_from_smaller_angles():
    joints = np.array([[1.0, -1.0, 0.0, 1.0], [2.0, -2.0, 1.0, 0.0], [3.0, -3.0, 0.0, 1.0]])
    every = tours.positive_approach_shares(joints, np.zeros(4), np.array([True, True, True]))
    np.testing.assert_allclose(every, [1.0, 0.0, 1 / 3, 2 / 3])
    some = tours.positive_approach_shares(joints, np.zeros(4), np.array([False, True, False]))
    np.testing.assert_allclose(some, [1.0, 0.0, 1.0, 0.0])


def test_every_shot_is_in_one_pair_far_enough_for_its_distance_to_tell():
    joints, points = placed(60)
    pairs = tours.neighbouring_pairs(joints, points, START)
    assert sorted(pairs.ravel().tolist()) == list(range(60))
    length = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    assert (length >= 0.99 * tours.WORTHWHILE_PAIR_MM).all()


def test_paired_neighbours_travel_less_than_random_pairs():
    joints, points = placed(60)
    near = tours.shortest_tour(joints, tours.neighbouring_pairs(joints, points, START), START)
    far = tours.shortest_tour(joints, random_pairs(points, np.random.default_rng(0)), START)
    assert travel(joints, near) < 0.8 * travel(joints, far)


@given(st.integers(2, 12), st.integers(0, 200))
def test_balanced_order_keeps_the_pairs_whole(count, seed):
    joints = np.random.default_rng(seed).uniform(-0.5, 1.5, (2 * count, 4))
    pairs = np.arange(2 * count).reshape(-1, 2)
    tour = tours.balance_approaches(joints, pairs, START, np.ones(2 * count, dtype=bool))
    assert {frozenset(pair) for pair in tour.tolist()} == {frozenset(p) for p in pairs.tolist()}


@pytest.mark.parametrize("count", [40, 20], ids=["all", "half"])
def test_tours_are_turned_until_counted_shots_are_approached_from_both_sides(count):
    stairs = np.linspace(0.0, 1.0, 40)[:, None] * np.ones(4)
    pairs, bottom, counted = np.arange(40).reshape(-1, 2), np.full(4, -0.1), np.arange(40) < count
    shortest = tours.shortest_tour(stairs, pairs, bottom).ravel()
    assert (tours.positive_approach_shares(stairs[shortest], bottom, counted) == 1.0).all()
    tour = tours.balance_approaches(stairs, pairs, bottom, counted).ravel()
    shares = tours.positive_approach_shares(stairs[tour], bottom, counted[tour])
    assert ((shares >= 0.37) & (shares <= 0.63)).all()
