"""A reflector on a platform that turns looks where the platform turns it: plans and views know."""

import numpy as np
import pytest
from bar_robots import robot_file
from scipy.spatial.transform import Rotation

from campaigns.design.pose_sampling import incidence_rad, interior_poses
from campaigns.planning.plan_check import view_fault
from campaigns.planning.plans import View, region_of
from campaigns.robots.robot import find_robot, pose_of

VIEW = View((2500.0, 0.0, -500.0), (1.0, 0.0, 0.0), np.radians(12.0))


@pytest.fixture
def hexapod(tmp_path):
    return find_robot(str(robot_file(tmp_path, "hexapod"))).robot


def turned_away_rad(poses):
    """Angles between beam and reflector, by other equations of turns."""
    facing = Rotation.from_rotvec(poses[:, 3:]).apply(VIEW.facing)
    beam = np.array(VIEW.tracker_mm) - poses[:, :3]
    return np.arccos(np.sum(beam * facing, axis=1) / np.linalg.norm(beam, axis=1))


def test_every_planned_pose_of_a_hexapod_turns_its_reflector_to_the_tracker(hexapod):
    region = region_of(hexapod, VIEW, pose_of(hexapod.workspace_centre))
    poses = interior_poses(region, 200, np.random.default_rng(1))
    assert turned_away_rad(poses).max() <= np.radians(12.0)
    turns = np.linalg.norm(poses[:, 3:], axis=1)
    assert turns.max() > np.radians(15.0), "about the beam it may turn farther"
    level = incidence_rad(poses[:, :3], np.array(VIEW.tracker_mm), np.array(VIEW.facing))
    assert level.max() < np.radians(6.0)


def test_a_shot_that_turns_the_reflector_away_is_named(hexapod):
    turned = np.array([0.0, 0.0, -550.0, 0.0, 0.0, np.radians(15.0)])
    about_the_beam = np.array([0.0, 0.0, -550.0, np.radians(14.0), 0.0, 0.0])
    mechanism = hexapod.mechanism
    assert view_fault(turned, VIEW, mechanism).startswith("reflector turned 15.0° from the tracker")
    assert view_fault(about_the_beam, VIEW, mechanism) == ""


def test_where_it_looks_is_stated_in_the_middle_of_the_workspace(hexapod):
    home = np.array([0.0, 0.0, -550.0, 0.0, 0.0, np.radians(10.0)])
    mechanism = hexapod.mechanism.with_home(home)
    further = np.array([0.0, 0.0, -550.0, 0.0, 0.0, np.radians(30.0)])
    (at_home, turned) = mechanism.facing(np.array([home, further]), np.array([1.0, 0.0, 0.0]))
    assert mechanism.home_at((1.0, 2.0, -500.0))[3:].tolist() == home[3:].tolist()
    assert at_home == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)
    assert turned == pytest.approx([np.cos(np.radians(20.0)), np.sin(np.radians(20.0)), 0.0])
