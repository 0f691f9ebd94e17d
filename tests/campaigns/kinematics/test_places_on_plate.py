"""Fitted places of reflector and joints on the plate: deviations from the drawing's places."""

from dataclasses import replace

import numpy as np
import pytest
from family_cases import ALL_MEMBERS, all_members

ON_PLATE = ("plate_joints", "reflector")


def places_of(member, group):
    return member.space.places(member.space.select(group=group))


def without(member, robot, *groups):
    p = robot.p.copy()
    for group in groups:
        p[places_of(member, group)] = 0.0
    return member.robot_of(p)


def drawn_as_fitted(member, robot):
    """The robot without deviations, on a drawing that has them."""
    chain, columns = member.mechanism, member.space.columns
    joints_mm = np.array(chain.plate.joints_mm) + np.transpose(
        [robot.p[columns[f"plate_joint_{c}"]] for c in "xyz"]
    )
    reflector_mm = chain.plate.reflector_mm + robot.p[places_of(member, "reflector")]
    plate = replace(
        chain.plate,
        joints_mm=tuple(map(tuple, joints_mm.tolist())),
        reflector_mm=tuple(reflector_mm.tolist()),
    )
    return replace(without(member, robot, *ON_PLATE), mechanism=chain.with_plate(plate))


def joints_near_middle(member):
    poses = member.poses(20, seed=8)
    return member.nominal.inverse(poses).values_or_raise()


@all_members
def test_deviations_are_a_changed_drawing(member):
    joints, robot = joints_near_middle(member), member.tilted
    poses = robot.forward(joints).values_or_raise()
    drawn = drawn_as_fitted(member, robot).forward(joints).values_or_raise()
    assert np.abs(poses - drawn).max() < 1e-9
    for group in ON_PLATE:
        other = without(member, robot, group).forward(joints).values_or_raise()
        assert np.abs(poses - other)[:, :3].max() > 0.05


@all_members
def test_level_plate_does_not_show_them(member):
    joints, p = joints_near_middle(member), member.perturbed.p.copy()
    level = member.robot_of(p).forward(joints).values_or_raise()
    for group in ON_PLATE:
        p[places_of(member, group)] = 10.0
    moved = member.robot_of(p)
    assert (moved.forward(joints).values == level).all()
    columns = moved.jacobian(joints, level)[..., places_of(member, "reflector")]
    assert np.abs(columns).max() < 1e-12


@pytest.mark.parametrize(
    "member", [each for each in ALL_MEMBERS if len(each.mechanism.task) > 3], ids=lambda m: m.name
)
def test_reflector_on_another_part_does_not_move_the_controlled_point(member):
    joints, fitted = joints_near_middle(member), member.tilted
    elsewhere = fitted.mechanism.seen_from(2)
    robots = [
        replace(r, mechanism=elsewhere) for r in (fitted, without(member, fitted, "reflector"))
    ]
    measured = [robot.forward(joints).values_or_raise() for robot in robots]
    assert np.abs(measured[0] - measured[1])[:, :3].max() > 0.05
    controlled = [robot.controlled.forward(joints).values_or_raise() for robot in robots]
    assert (controlled[0] == controlled[1]).all()
    columns = robots[0].controlled.jacobian(joints, controlled[0])
    assert not columns[..., places_of(member, "reflector")].any()
    assert columns[..., places_of(member, "plate_joints")].any()
