"""The simulator's eight rods and the estimator's contracted model, which share no equation."""

import numpy as np
import pytest
from par4_cases import ROBOTS, reachable_joints

from campaigns.numerics.forward import forward
from sim.geometry import geometry_of
from sim.rods import Build, EightRods, Plate

PLATE_JOINTS_MM = np.array([[-60, 5, 3], [55, 0, -2], [60, 10, 0], [-70, 0, 4.0]])


def eight_rods(geometry, tilts_rad=0.0):
    build = Build(
        plate_joints_mm=PLATE_JOINTS_MM,
        rod_spacing_mm=80.0,
        rod_errors_mm=np.zeros((4, 2)),
        axis_tilts_rad=np.full(4, tilts_rad) * [1, -1, 1, 1],
    )
    return EightRods(geometry_of(geometry.flat()), build)


def settled(rods, joints, near):
    """The plate (7,): place in mm, rotations and θ in rad."""
    guess = Plate(np.array([*near[:3], 0.0, 0.0, 0.0, near[3]]))
    return rods.settle(joints, 0.0, guess)[0].unknowns


@pytest.mark.parametrize("robot", ROBOTS)
def test_perfect_rods_stand_where_the_contracted_model_says(robot):
    geometry = ROBOTS[robot]
    rods = eight_rods(geometry)
    joints = reachable_joints(geometry, 500, seed=91)
    poses = forward(geometry, joints).require()
    near = poses + np.random.default_rng(0).uniform(-1, 1, poses.shape) * [5, 5, 5, 0.02]
    plates = np.array([settled(rods, *row) for row in zip(joints, near, strict=True)])
    assert np.abs(plates[:, :3] - poses[:, :3]).max() < 1e-9
    assert np.abs(plates[:, 6] - poses[:, 3]).max() < 1e-11
    assert np.abs(plates[:, 3:6]).max() < 1e-11


def test_tilted_axes_leave_the_contracted_model():
    """What makes the comparison above able to fail."""
    geometry = ROBOTS["par4-prototype"]
    joints = reachable_joints(geometry, 20, seed=92)
    poses = forward(geometry, joints).require()
    rods = eight_rods(geometry, tilts_rad=5e-4)
    plates = np.array([settled(rods, *row) for row in zip(joints, poses, strict=True)])
    assert np.linalg.norm(plates[:, :3] - poses[:, :3], axis=1).max() > 0.05
