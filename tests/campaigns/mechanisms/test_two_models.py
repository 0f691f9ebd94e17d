"""The simulator's eight rods and the estimator's contracted model, which share no equation."""

import numpy as np
import pytest
from par4_cases import LEVEL_ROBOTS, NOMINAL, TILTED, reachable_joints
from par4_space import NAMES, TILTS, par4

from campaigns.mechanisms.par4 import PAR4
from sim.geometry import geometry_of
from sim.robot.rods import Build, Plate, RodMechanism

PLATE_JOINTS_MM = np.array([[-60, 5, 3], [55, 0, -2], [60, 10, 0], [-70, 0, 4.0]])


def eight_rods(geometry, rod_spacing_mm=80.0):
    flat = geometry.parameters
    build = Build(
        plate_joints_mm=PLATE_JOINTS_MM,
        rod_spacing_mm=rod_spacing_mm,
        rod_errors_mm=np.zeros((4, 2)),
        axis_tilts_rad=geometry.p[TILTS],
    )
    return RodMechanism(geometry_of({name: flat[name] for name in NAMES}), build)


def level_plate(pose):
    """A pose (4,) as the simulator's seven unknowns: place in mm, rotations and θ in rad."""
    return np.array([*pose[:3], 0.0, 0.0, 0.0, pose[3]])


def settled(rods, joints, near):
    """The plate (7,): place in mm, rotations and θ in rad."""
    return rods.settle(joints, 0.0, Plate(level_plate(near)))[0].unknowns


@pytest.mark.slow
@pytest.mark.parametrize("robot", LEVEL_ROBOTS)
def test_perfect_rods_stand_where_the_contracted_model_says(robot):
    geometry = LEVEL_ROBOTS[robot]
    rods = eight_rods(geometry)
    joints = reachable_joints(geometry, 500, seed=91)
    poses = geometry.forward(joints).values_or_raise()
    near = poses + np.random.default_rng(0).uniform(-1, 1, poses.shape) * [5, 5, 5, 0.02]
    plates = np.array([settled(rods, *row) for row in zip(joints, near, strict=True)])
    assert np.abs(plates[:, :3] - poses[:, :3]).max() < 1e-9
    assert np.abs(plates[:, 6] - poses[:, 3]).max() < 1e-11
    assert np.abs(plates[:, 3:6]).max() < 1e-11


def test_tilted_axes_leave_the_level_model():
    """What makes the comparison above able to fail: a model without tilts misses by so much."""
    joints = reachable_joints(TILTED, 20, seed=92)
    flat = NOMINAL.parameters | {f"arm{arm}.axis_tilt_deg": np.degrees(5e-4) for arm in range(4)}
    poses = NOMINAL.forward(joints).values_or_raise()
    rods = eight_rods(par4(flat))
    plates = np.array([settled(rods, *row) for row in zip(joints, poses, strict=True)])
    assert np.linalg.norm(plates[:, :3] - poses[:, :3], axis=1).max() > 0.05


def test_a_tilted_axis_swings_the_elbow_to_the_middle_of_its_two_rods():
    joints = reachable_joints(TILTED, 50, seed=93)
    rods = eight_rods(TILTED)
    middles = np.array([rods.elbows_mm(q, 0.0).reshape(4, 2, 3).mean(axis=1) for q in joints])
    elbows = PAR4.posture(TILTED.p, joints).arms.elbows_mm.T
    assert np.abs(middles - PLATE_JOINTS_MM - elbows).max() < 1e-11
