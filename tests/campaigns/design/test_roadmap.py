"""Roadmap: what can be come to from the centre, and by which positions."""

from itertools import pairwise

import numpy as np
import pytest
from par4_cases import CENTRE, LIMITS, NOMINAL

from campaigns.design.restricted_space import ANYWHERE, Disc, Rectangle, RestrictedSpace, Zone
from campaigns.design.roadmap import Roadmap

WALL = Zone("wall", Rectangle((200.0, 201.0)), ANYWHERE, keeps_in=False)
PILLAR = Zone("pillar", Disc((-250.0, 0.0), 20.0), ANYWHERE, keeps_in=False)
WALLED = RestrictedSpace((WALL, PILLAR), 50.0)


@pytest.fixture(scope="module")
def roadmap():
    return Roadmap.of(NOMINAL, LIMITS, WALLED, CENTRE)


def test_what_is_behind_a_wall_is_not_connected_and_there_is_no_way_to_it(roadmap):
    points = np.array([[100.0, 0.0, -600.0], [300.0, 0.0, -600.0], [-330.0, 0.0, -600.0]])
    assert roadmap.space.allows(points).all()
    assert roadmap.connected(points).tolist() == [True, False, True]
    assert roadmap.poses[:, 0].max() <= 150.0
    start, end = np.array([0.0, 0.0, -600.0]), np.array([300.0, 0.0, -600.0])
    assert roadmap.way(start, end, frozenset()) is None


def test_every_pose_is_one_that_the_robot_can_take(roadmap):
    assert len(roadmap.poses) > 500
    assert NOMINAL.feasibility(LIMITS, roadmap.poses).feasible.all()
    assert WALLED.allows(roadmap.poses[:, :3]).all()


def test_ways_lead_by_clear_lines_round_a_pillar_and_never_again_by_a_blocked_one(roadmap):
    start, end = np.array([-340.0, 0.0, -600.0]), np.array([-100.0, 0.0, -600.0])
    assert not roadmap.are_clear(start[None], end[None])[0]
    way = roadmap.way(start, end, frozenset())
    points = np.vstack([roadmap.poses[:, :3], start, end])[list(way)]
    assert roadmap.are_clear(points[:-1], points[1:]).all()
    assert (points[0] == start).all()
    assert (points[-1] == end).all()
    start, end = np.array([-340.0, 0.0, -600.0]), np.array([-100.0, 0.0, -600.0])
    way = roadmap.way(start, end, frozenset())
    held = tuple(sorted(way[1:3]))
    other = roadmap.way(start, end, frozenset({held}))
    assert held not in {tuple(sorted(leg)) for leg in pairwise(other)}


def test_a_centre_that_is_walled_in_leaves_nothing():
    cage = Zone("cage", Rectangle((-40.0, 40.0), (-40.0, 40.0)), (-620.0, -540.0), keeps_in=False)
    nothing = Roadmap.of(NOMINAL, LIMITS, RestrictedSpace((cage,), 50.0), CENTRE)
    assert len(nothing.poses) == 0
    assert not nothing.connected(np.array([[300.0, 0.0, -600.0]])).any()
