"""The simulator's rods and the kinematic model, which share no equation."""

from dataclasses import replace

import numpy as np
import pytest
from family_cases import ALL_MEMBERS, all_members

from sim.geometry import PLATE_KINDS, geometry_of
from sim.robot.assembly import joints_for
from sim.robot.rods import Build, Plate, RodMechanism

OFFSET_MM = np.array([20.0, -30.0, -45.0])
POSES = 20


def kind_of(member):
    return PLATE_KINDS[member.name]


def twin(member, robot, *, rods_mm=0.0, tilts_rad=0.0, leans_rad=0.0, seed=0):
    """Rods of a robot whose plate joints are a few cm from its controlled point, each elsewhere."""
    arms, draw = member.space.arms, np.random.default_rng(seed)
    flat = robot.parameters
    geometry = geometry_of({name: flat[name] for name in member.space.names}, kind_of(member))
    aside = 50.0 * geometry.outward + draw.uniform(-10.0, 10.0, (arms, 3))
    build = Build(
        plate_joints_mm=aside,
        rod_spacing_mm=80.0,
        rod_errors_mm=rods_mm * draw.standard_normal((arms, 2)),
        axis_tilts_rad=tilts_rad * draw.standard_normal(arms),
        leans_rad=leans_rad * draw.standard_normal(arms) if kind_of(member).on_rails else None,
    )
    return RodMechanism(geometry, build)


def plate_at(member, pose):
    turn = pose[3] if len(pose) > 3 else 0.0
    return Plate.level(kind_of(member), pose[:3], turn)


def settled(member, rods, joints, poses):
    return [
        rods.settle(row, plate_at(member, pose))[0] for row, pose in zip(joints, poses, strict=True)
    ]


@all_members
def test_perfect_rods_equal_the_model(member):
    """From a guess beside, both in place and in direction."""
    robot = member.perturbed
    rods = twin(member, robot)
    poses = member.reachable_poses(robot, POSES, seed=41)
    joints = robot.inverse(poses).values_or_raise()
    beside = poses + np.random.default_rng(1).uniform(-2.0, 2.0, poses.shape) * [
        *(1.0, 1.0, 1.0, 0.01)[: poses.shape[1]]
    ]
    for plate, pose in zip(settled(member, rods, joints, beside), poses, strict=True):
        assert np.abs(plate.position_mm - pose[:3]).max() < 1e-9
        assert np.abs(plate.unknowns[3:6]).max() < 1e-11
        assert np.abs(np.degrees(plate.unknowns[6:] - pose[3:])).max(initial=0.0) < 1e-9
        seen = rods.reflector_mm(plate, OFFSET_MM * [0.0, 0.0, 1.0])
        assert np.abs(seen - pose[:3] - [0.0, 0.0, OFFSET_MM[2]]).max() < 1e-8


@all_members
def test_the_controller_s_own_inverse_agrees_with_the_model_s(member):
    robot = member.perturbed
    flat = robot.parameters
    geometry = geometry_of({name: flat[name] for name in member.space.names}, kind_of(member))
    poses = member.reachable_poses(robot, 50, seed=42)
    joints = robot.inverse(poses).values_or_raise()
    for row, pose in zip(joints, poses, strict=True):
        turn = pose[3] if len(pose) > 3 else 0.0
        assert np.abs(joints_for(geometry, pose[:3], turn) - row).max() < 1e-10


@pytest.mark.parametrize("half", [1, 2])
@pytest.mark.parametrize(
    "member", [each for each in ALL_MEMBERS if kind_of(each).turn], ids=lambda each: each.name
)
def test_a_reflector_on_either_half_is_where_the_model_has_it(member, half):
    controlled = member.perturbed
    robot = replace(controlled, mechanism=member.mechanism.seen_from(half))
    rods = twin(member, controlled)
    poses = member.reachable_poses(robot, POSES, seed=46)
    joints = robot.inverse(poses).values_or_raise()
    level = controlled.forward(joints).values_or_raise()
    assert np.abs(level - robot.controlled.forward(joints).values_or_raise()).max() < 1e-9
    for plate, pose in zip(settled(member, rods, joints, level), poses, strict=True):
        assert np.abs(rods.reflector_mm(plate, OFFSET_MM, half) - OFFSET_MM - pose[:3]).max() < 1e-8
        assert np.abs(plate.theta_rad - pose[3]) < 1e-10
    assert robot.forward(joints).values_or_raise() == pytest.approx(poses, abs=1e-8)
