"""Datum transformation: the same robot by other parameters of its frame."""

import numpy as np
import pytest
from family_cases import all_members

from campaigns.estimation.datum import datum_parameters
from campaigns.estimation.rigid_transforms import fit_transform


def of_parts(member, tilt_rad, seed=1):
    """Robot off in everything that parts may be."""
    rng, space, p = np.random.default_rng(seed), member.space, member.perturbed.p.copy()
    for ending in ("rail_tilt_deg", "axis_tilt_deg", "skew_deg", "elevation_deg"):
        names = [name for name in space.geometry if name.endswith(ending)]
        p[space.places(names)] += tilt_rad * rng.standard_normal(len(names))
    return member.robot_of(p)


def apart_mm(member, one, other):
    """Largest difference of the points of two robots but for a rigid motion."""
    inside = member.reachable_poses(member.perturbed, 20, seed=2, limits=member.well_inside)
    joints = member.perturbed.inverse(inside).values_or_raise()
    own, points = (each.forward(joints).values_or_raise()[:, :3] for each in (one, other))
    left = fit_transform(own, points).apply(own) - points
    return np.abs(left).max()


def held(member):
    return member.space.places([n for n in member.space.datum if n in member.space.geometry])


@all_members
def test_a_robot_off_in_everything_is_the_same_with_the_nominal_datum(member):
    rng, p = np.random.default_rng(7), member.perturbed.p.copy()
    moved = [name for name in member.space.names if "elevation" not in name]
    p[member.space.places(moved)] += 0.02 * rng.standard_normal(len(moved))
    own = member.robot_of(p)
    seen = datum_parameters(member.nominal, own)
    assert (seen.p[held(member)] == member.nominal.p[held(member)]).all()
    assert not seen.parameters.extended_by
    assert apart_mm(member, own, seen) < 1e-9
    assert datum_parameters(member.nominal, seen).p == pytest.approx(seen.p, abs=1e-9)


@all_members
def test_imperfect_parts_differ_by_a_rigid_motion_but_for_second_order(member):
    """Plate bars follow the azimuths of tilted arms, and carriages' plates tilt for the base."""
    left_mm = []
    for tilt_rad in (1e-3, 5e-4):
        robot = of_parts(member, tilt_rad)
        seen = datum_parameters(member.nominal, robot)
        assert (seen.p[held(member)] == member.nominal.p[held(member)]).all()
        left_mm.append(apart_mm(member, robot, seen))
    assert left_mm[0] < 5e-4
    assert left_mm[0] / left_mm[1] == pytest.approx(4.0, abs=0.3)
