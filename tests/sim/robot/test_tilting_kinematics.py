"""A controller's kinematics of imperfect parts, by rods, against the product's own model."""

import math
from dataclasses import replace

import numpy as np
import pytest

from campaigns.kinematics.parameters import Role
from campaigns.kinematics.platforms import PlateGeometry as Drawing
from campaigns.robots.robot import RobotFile, find_robot
from sim.geometry import PLATE_KINDS, geometry_of
from sim.robot.assembly import OutOfReach, joints_for
from sim.robot.tilting_kinematics import KnownPlate, tilted_joints_for

ROBOTS = {name: "par4-prototype" if name == "par4" else name for name in PLATE_KINDS}
SPACING_MM = 80.0
POSES = 4
LEFT_RMS_MM = 4e-4
"""Of second order in the rods' differences and the tilts (model.md)."""


def rms(errors):
    return float(np.sqrt(np.mean(errors**2)))


def drawn(name):
    """A robot with rods off by some 0.05 mm, axes and bars off by 0.5 mrad, and poses in reach."""
    draw, nominal = np.random.default_rng(3), find_robot(ROBOTS[name]).robot
    space, kind = nominal.mechanism.parameters, PLATE_KINDS[name]
    outward = geometry_of(dict(nominal.parameters), kind).outward
    drawing = KnownPlate(50.0 * outward, SPACING_MM, np.array([0.0, 0.0, -45.0]))
    plate = Drawing(
        tuple(map(tuple, drawing.joints_mm.tolist())),
        (0.0, 0.0, -45.0),
        tuple(np.arctan2(outward[:, 1], outward[:, 0]).tolist()) if kind.on_rails else None,
    )
    skew, tilt = math.degrees(0.07 / SPACING_MM), math.degrees(5e-4)
    sizes = {"parallelogram_skew_deg": skew}
    extensions = {
        key: draw.normal(0.0, sizes.get(space[key].field.name, tilt))
        for key in space.select(Role.EXTENSION)
    }
    compliance = 0.1 if kind.on_rails else 0.02
    sizes = {"sag": 0.05, "compliance": compliance, "plate_joints": 5.0, "reflector": 20.0}
    for group, size in sizes.items():
        extensions |= {key: draw.normal(0.0, size) for key in space.select(group=group)}
    if kind.turns_point:  # a part that turns must carry the reflector on its axis
        extensions |= {"reflector_x_mm": 0.0, "reflector_y_mm": 0.0}
    robot = RobotFile.of(
        replace(nominal, mechanism=nominal.mechanism.with_plate(plate)).mechanism,
        nominal.parameters | extensions,
        name=name,
        limits=nominal.limits,
    )
    limits = nominal.limits.narrowed_by(swing_rad=0.1)
    found = robot.kinematics.forward(draw.uniform(*limits.joint, (50 * POSES, kind.arms)))
    poses = found.values[found.is_solved]
    feasible = robot.kinematics.feasibility(limits, poses).feasible
    return robot, kind, drawing, poses[feasible][:POSES]


@pytest.mark.parametrize("name", PLATE_KINDS)
def test_rods_put_the_reflector_where_the_models_tilted_plate_has_it(name):
    robot, kind, drawing, poses = drawn(name)
    flat = dict(robot.parameters)
    wanted = [(pose[:3], float(pose[3:].sum())) for pose in poses]
    tilted = np.array([tilted_joints_for(flat, kind, drawing, *pose) for pose in wanted])
    plain = np.array([joints_for(geometry_of(flat, kind), *pose) for pose in wanted])
    left_mm, shift_mm = (
        rms((robot.kinematics.forward(joints, near=poses).values_or_raise() - poses)[:, :3])
        for joints in (tilted, plain)
    )
    assert left_mm < LEFT_RMS_MM
    assert shift_mm > 50.0 * left_mm
    assert shift_mm > 0.02


def test_pose_out_of_reach_is_told():
    robot, kind, drawing, _ = drawn("delta")
    with pytest.raises(OutOfReach):
        tilted_joints_for(
            dict(robot.parameters), kind, drawing, np.array([3000.0, 0.0, -500.0]), 0.0
        )
