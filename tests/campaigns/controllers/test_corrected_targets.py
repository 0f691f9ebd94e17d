"""Corrected targets: commanded to the nominal controller, they bring the robot where it should."""

import numpy as np
import pytest
from family_cases import BY_NAME, all_members, some_members

from campaigns.controllers.corrected_targets import TargetCorrection
from campaigns.design.restricted_space import Rectangle, RestrictedSpace, Zone
from campaigns.errors import TargetsInvalid
from campaigns.fit.rigid_transforms import fit_transform
from campaigns.identification.result import ParameterCovariance
from campaigns.kinematics.catalog import FAMILY
from campaigns.kinematics.model import Kinematics


def correction_of(member, **more):
    return TargetCorrection(member.tilted, member.nominal, member.limits, **more)


def test_every_mechanism_is_tried():
    assert set(BY_NAME) == set(FAMILY)


@all_members
def test_the_robot_stands_where_it_was_wanted(member):
    correction = correction_of(member)
    wanted = member.poses(60)
    commanded = correction.commanded(wanted).values_or_raise()
    joints = member.nominal.inverse(commanded).values_or_raise()
    there = member.tilted.forward(joints, wanted).values_or_raise()
    assert np.abs(there - wanted).max() < 1e-8
    assert np.abs(commanded - wanted).max() > 0.1


@some_members
def test_targets_one_after_another_follow_the_sides_that_joints_come_from(member):
    space = member.space
    names = space.select(group="backlash")
    lost = {name: 0.05 if space[name].unit == "deg" else 0.2 for name in names}
    worn = Kinematics.of(member.mechanism, member.tilted.parameters | lost)
    correction = TargetCorrection(worn, member.nominal, member.limits)
    wanted = member.poses(40)
    sides = correction.approach(wanted)
    assert (sides[0] == 0.0).all()
    assert {*np.unique(sides[1:])} == {-1.0, 1.0}
    reached = {}
    for name, known in (("sides", sides), ("none", None)):
        commanded = correction.commanded(wanted, known).values_or_raise()
        joints = member.nominal.inverse(commanded).values_or_raise()
        there = worn.forward(joints, wanted, sides).values_or_raise()
        reached[name] = np.abs(there - wanted)[1:, :3].max()
    assert reached["sides"] < 1e-7
    assert reached["none"] > 0.05


@some_members
def test_the_first_pose_out_of_reach_is_named(member):
    correction = correction_of(member)
    wanted = member.poses(5)
    correction.require_possible(wanted, str)
    wanted[3, 0] += 10_000.0
    with pytest.raises(TargetsInvalid, match=r"^3: .*out of reach"):
        correction.require_possible(wanted, str)
    assert not correction.commanded(wanted).is_solved[3]


def test_a_pose_beyond_a_limit_or_outside_the_space_is_refused_with_value_and_limit():
    member = BY_NAME["par4"]
    wanted = member.poses(3)
    wanted[1, 3] = np.radians(50.0)
    with pytest.raises(TargetsInvalid, match=r"^1: .*50.000° outside \[-45°, 45°\]"):
        correction_of(member).require_possible(wanted, str)
    wanted = member.poses(20)
    zone = Zone("space.z_mm", Rectangle(), (float(wanted[7, 2]) + 1e-3, np.inf), keeps_in=True)
    row = int(np.argmax(wanted[:, 2] < zone.z_mm[0] - 1e-6))
    with pytest.raises(TargetsInvalid, match=rf"^{row}: .*below space.z_mm"):
        correction_of(member, space=RestrictedSpace((zone,))).require_possible(wanted, str)


@some_members
def test_the_uncertainty_is_that_of_positions_after_the_best_fit_of_the_frame(member):
    """Against the moves of points by the columns of a covariance's root, the frame fitted anew."""
    robot, poses, names = member.perturbed, member.poses(60), member.free
    places = member.space.places(names)
    units = member.space.file_unit[places]
    root = 1e-3 * np.random.default_rng(3).standard_normal((len(names), 4))
    matrix = tuple(map(tuple, (root @ root.T).tolist()))
    known = ParameterCovariance(names, matrix, hold_out_ratio=1.5)
    correction = TargetCorrection(
        robot, member.nominal, member.limits, uncertainty=known, measured=poses
    )
    joints, squares = robot.inverse(poses).values_or_raise(), np.zeros(len(poses))
    for column in root.T:
        p = robot.p.copy()
        p[places] += column * units
        moved = Kinematics(member.mechanism, p).forward(joints, poses).values_or_raise()[:, :3]
        errors = fit_transform(moved, poses[:, :3]).apply(moved) - poses[:, :3]
        squares += (errors**2).sum(axis=1)
    expected = 1.5 * np.sqrt(squares)
    np.testing.assert_allclose(correction.std_mm(poses), expected, rtol=0.01)
    np.testing.assert_allclose(correction.std_mm(poses[4:5]), expected[4:5], rtol=0.05)
