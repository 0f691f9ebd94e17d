"""Robots of bars move as the estimator's model has it, with perfect parts and with errors."""

import numpy as np
import pytest
from bar_robots import FIVE_BAR, HOMES, ROBOTS, poses_of

from campaigns.kinematics.catalog import MECHANISMS
from campaigns.kinematics.model import Kinematics
from sim.errors import AssemblyLost
from sim.geometry import BAR_KINDS, IN_PLANE, ON_PLATFORM, BarKind, Limb
from sim.robot.assembly import OutOfReach, follow, restore
from sim.robot.bars import BarMechanism, TurningPlate
from sim.robot.rods import Growth
from sim.robot.transmission import Load

POSES = 20

each_kind = pytest.mark.parametrize("name", BAR_KINDS)


def estimated(name, flat, joints, poses):
    """Poses (N, 6) of joints by the estimator's model, near given ones."""
    mechanism = MECHANISMS[name]
    size = len(mechanism.task)
    found = Kinematics.of(mechanism, flat).forward(joints, poses[:, :size]).values_or_raise()
    return np.column_stack([found, np.zeros((len(found), 6 - size))])


def settled(name, flat, joints, poses):
    robot = BarMechanism(BAR_KINDS[name], flat)
    near = [TurningPlate(pose) for pose in poses + 0.01 * (poses != 0.0)]
    return np.array([robot.settle(*each).plate.unknowns for each in zip(joints, near, strict=True)])


def joints_of(name, flat, poses):
    robot = BarMechanism(BAR_KINDS[name], flat)
    return np.array([robot.joints_for(pose) for pose in poses])


def made(name, seed):
    """A robot as it was made: each parameter beside its nominal value."""
    draw = np.random.default_rng(seed)
    return {key: value + draw.normal(0.0, 0.7) for key, value in ROBOTS[name].items()}


@each_kind
def test_its_parameters_are_those_of_the_robot_file_in_their_order(name):
    assert BAR_KINDS[name].names == MECHANISMS[name].parameters.names
    table = MECHANISMS[name].parameters
    assert {*BAR_KINDS[name].optional} == {*table.optional} - {*table.rates}


@each_kind
def test_with_perfect_parts_both_models_are_one_mechanism(name):
    flat, poses = ROBOTS[name], poses_of(name, POSES, seed=1)
    joints = joints_of(name, flat, poses)
    size = len(MECHANISMS[name].task)
    by_estimator = Kinematics.of(MECHANISMS[name], flat).inverse(poses[:, :size])
    assert np.abs(by_estimator.values_or_raise() - joints).max() < 1e-9
    assert np.abs(settled(name, flat, joints, poses) - poses).max() < 1e-9
    assert np.abs(estimated(name, flat, joints, poses) - poses).max() < 1e-9


@each_kind
def test_a_robot_with_errors_moves_as_the_closures_say(name):
    poses, flat = poses_of(name, POSES, seed=2), made(name, seed=3)
    joints = joints_of(name, ROBOTS[name], poses)
    real = settled(name, flat, joints, poses)
    assert np.abs(real - poses).max() > 0.5
    assert np.abs(real - estimated(name, flat, joints, poses)).max() < 1e-6


@each_kind
def test_it_follows_its_joints_from_pose_to_pose_and_back(name):
    robot = BarMechanism(BAR_KINDS[name], made(name, seed=4))
    home, *others = poses_of(name, 6, seed=5)
    here = start = restore(robot, robot.joints_for(home), robot.plate_of(home))
    for pose in others:
        here = follow(robot, here, robot.joints_for(pose))
        assert np.abs(here.plate.unknowns - pose).max() < 1e-8
    back = follow(robot, here, start.joints)
    assert np.abs(back.plate.unknowns - home).max() < 1e-8


def test_turns_add_up_in_the_base_frame_and_far_from_none():
    plate = TurningPlate(np.array([1.0, 2.0, 3.0, 2.0, -1.0, 0.5]))
    turn = np.array([0.3, 0.2, -0.4])
    by_matrices = TurningPlate(np.array([0.0, 0.0, 0.0, *turn])).rotation @ plate.rotation
    assert np.allclose(plate.moved(np.zeros(3), turn).rotation, by_matrices, atol=1e-14)


def test_a_pose_beyond_its_arms_is_out_of_reach():
    with pytest.raises(OutOfReach):
        BarMechanism(BAR_KINDS["five-bar"], FIVE_BAR).joints_for(np.array([0, 600.0, 0, 0, 0, 0]))


def test_the_way_through_a_singularity_is_closed():
    """The point cannot pass through the line of its elbows into the other assembly."""
    robot = BarMechanism(BAR_KINDS["five-bar"], FIVE_BAR)
    home = np.array([*HOMES["five-bar"], 0.0, 0.0, 0.0])
    start = restore(robot, robot.joints_for(home), robot.plate_of(home))
    apart = np.radians([80.0, -80.0])
    with pytest.raises(AssemblyLost):
        follow(robot, start, start.joints + apart)


def test_warm_legs_lift_or_lower_the_platform_by_their_own_growth():
    robot = BarMechanism(BAR_KINDS["hexapod"], ROBOTS["hexapod"])
    home = robot.plate_of(np.array([*HOMES["hexapod"], 0.0, 0.0, 0.0]))
    joints = robot.joints_for(home.unknowns)
    grown = robot.settle(joints, home, Growth(arms=1e-4, frame=1e-4)).plate
    leg_mm = np.hypot(550.0, np.linalg.norm([398.5 - 86.0, 34.9 - 122.9]))
    assert -550.0 - grown.position_mm[2] == pytest.approx(1e-4 * leg_mm * leg_mm / 550.0, rel=0.3)


def test_weights_give_way_by_virtual_work():
    """The same weight on one leg of a symmetrical hexapod is a sixth of it, by the slope."""
    robot = BarMechanism(BAR_KINDS["hexapod"], ROBOTS["hexapod"])
    home = robot.plate_of(np.array([*HOMES["hexapod"], 0.0, 0.0, 0.0]))
    joints = robot.joints_for(home.unknowns)
    yielded = Load(at_plate_n=60.0, stiffness=1e3).yielding(robot, joints, home)
    slope = 550.0 / (joints + 450.0)
    assert yielded == pytest.approx(60.0 / 1e3 / 6.0 / slope, rel=1e-4)


def test_a_further_mechanism_is_a_row_of_a_table():
    """3-RRR: three cranks and bars, and a platform that turns in the plane."""
    limb = Limb("crank", (*IN_PLANE, *ON_PLATFORM[:2]))
    kind = BarKind("3-rrr", (limb,) * 3, free=(0, 1, 5))
    flat = {}
    for arm, around in enumerate(np.radians([90.0, 210.0, 330.0])):
        row = {"x_mm": 300 * np.cos(around), "y_mm": 300 * np.sin(around)}
        row |= {"joint_offset_deg": 20.0, "arm_mm": 180.0, "forearm_mm": 200.0}
        row |= {"plate_x_mm": 60 * np.cos(around), "plate_y_mm": 60 * np.sin(around)}
        flat |= {f"arm{arm}.{key}": float(value) for key, value in row.items()}
    assert kind.turns == ("theta",)
    robot, pose = BarMechanism(kind, flat), np.array([12.0, -20.0, 0.0, 0.0, 0.0, 0.2])
    found = robot.settle(robot.joints_for(pose), TurningPlate(0.9 * pose)).plate
    assert np.abs(found.unknowns - pose).max() < 1e-9
