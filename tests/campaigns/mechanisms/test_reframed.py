"""A robot of imperfect parts seen from a base that its first axes level."""

import numpy as np
import pytest
from family_cases import MEMBERS

from campaigns.estimation.rigid_transforms import fit_transform
from campaigns.mechanisms.frames import tilting, upright_seen_from


def of_parts(member, tilt_rad, seed=1):
    """Robot off in everything that parts may be."""
    rng, space, p = np.random.default_rng(seed), member.space, member.perturbed.p.copy()
    for ending in ("rail_tilt_deg", "axis_tilt_deg", "skew_deg", "elevation_deg"):
        names = [name for name in space.geometry if name.endswith(ending)]
        p[space.places(names)] += tilt_rad * rng.standard_normal(len(names))
    return member.robot_of(p)


def apart_mm(member, one, other):
    """Largest difference of the points of two robots but for a rigid motion."""
    poses = member.reachable_poses(one, 60, seed=2, limits=member.well_inside)
    joints = one.inverse(poses).values_or_raise()
    points = other.forward(joints).values_or_raise()[:, :3]
    left = fit_transform(poses[:, :3], points).apply(poses[:, :3]) - points
    return np.abs(left).max()


@pytest.mark.parametrize("member", MEMBERS, ids=lambda each: each.name)
def test_the_frame_s_parameters_of_imperfect_parts_become_nominal(member):
    seen = member.mechanism.in_frame_of(member.nominal.p, of_parts(member, 2e-3).p)
    held = [name for name in member.space.datum if name in member.space.geometry]
    places = member.space.places([name for name in held if not name.endswith("azimuth_deg")])
    assert seen[places] == pytest.approx(member.nominal.p[places], abs=1e-9)


@pytest.mark.parametrize("member", MEMBERS, ids=lambda each: each.name)
def test_points_of_imperfect_parts_differ_by_a_rigid_motion_but_for_second_order(member):
    """Plate bars follow the azimuths of tilted arms, and carriages' plates tilt for the base."""
    left_mm = []
    for tilt_rad in (2e-3, 1e-3, 5e-5):
        robot = of_parts(member, tilt_rad)
        seen = member.robot_of(member.mechanism.in_frame_of(member.nominal.p, robot.p))
        left_mm.append(apart_mm(member, robot, seen))
    assert left_mm[0] < 5e-4
    assert left_mm[0] / left_mm[1] == pytest.approx(4.0, abs=0.3)
    assert left_mm[2] < 1e-6


def test_upright_is_found_where_directions_rise_as_wanted():
    directions = np.array([[1.0, 0.0, 0.02], [0.0, 1.0, -0.01]])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    up = upright_seen_from(directions, np.array([0.001, 0.003]))
    seen = directions @ tilting(up).T
    assert seen[:, 2] == pytest.approx([0.001, 0.003], abs=1e-15)
    assert tilting(up) @ up == pytest.approx([0.0, 0.0, 1.0], abs=1e-15)
    assert tilting(up) @ tilting(up).T == pytest.approx(np.eye(3), abs=1e-15)


def test_parallel_directions_leave_the_base_as_upright_as_they_allow():
    direction = np.array([np.cos(0.01), 0.0, np.sin(0.01)])
    up = upright_seen_from(np.array([direction, -direction]), np.zeros(2))
    assert up == pytest.approx([-np.sin(0.01), 0.0, np.cos(0.01)], abs=1e-15)
