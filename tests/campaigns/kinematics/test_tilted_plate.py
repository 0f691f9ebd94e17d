"""Plate tilt by unequal rods and tilted axes, against the simulator's rods, which share nothing."""

from dataclasses import replace

import numpy as np
import pytest
from family_cases import all_members
from par4_cases import NOMINAL, TILTED, reachable_joints
from scipy.spatial.transform import Rotation

from campaigns.kinematics.catalog import PAR4
from campaigns.kinematics.model import Kinematics
from campaigns.kinematics.platforms import PlateGeometry
from campaigns.robots.robot import find_robot, parse_robot
from sim.geometry import PLATE_KINDS, geometry_of
from sim.robot.rods import Build, Plate, RodMechanism, turned

DRAWING = PlateGeometry(
    ((-60.0, 5.0, 3.0), (55.0, 0.0, -2.0), (60.0, 10.0, 0.0), (-70.0, 0.0, 4.0)),
    (20.0, -30.0, -45.0),
)
SPACING_MM = 80.0
DRAWN = PAR4.with_plate(DRAWING)


def rms(vectors):
    return np.sqrt((vectors**2).sum(axis=1).mean())


def tilts_of(robot, joints):
    """Rotation vectors (N, 3) of the plate out of level."""
    return robot.mechanism.assemble(robot.p, joints).unknowns[:, -3:]


def test_perfect_parts_leave_the_plate_level_and_one_bad_row_the_others_alone():
    joints = reachable_joints(NOMINAL, 20, seed=4)
    poses = NOMINAL.forward(joints).values_or_raise()
    drawn = replace(NOMINAL, mechanism=DRAWN)
    assert DRAWN.assemble(NOMINAL.p, joints).unknowns.shape == poses.shape
    assert (drawn.forward(joints).values == poses).all()
    drawn, joints = replace(TILTED, mechanism=DRAWN), reachable_joints(TILTED, 5, seed=6)
    bad = joints.copy()
    bad[2] = [-3.0, 3.0, 1.0, -2.0]
    found = drawn.forward(bad)
    assert found.is_solved.tolist() == [True, True, False, True, True]
    good = drawn.forward(joints).values
    assert np.abs(found.values - good)[found.is_solved].max() < 1e-9


def test_a_drawing_is_read_from_the_robot_s_file_and_typical_without_one():
    document = find_robot("par4-prototype").document
    text = document.text.replace("# reflector_mm: [x, y, z]", "reflector_mm: [20.0, -30.0, -45.0]")
    drawn = parse_robot(text, "stated.yaml").robot.mechanism.plate
    assert drawn.reflector_mm == (20.0, -30.0, -45.0)
    assert drawn.joints_mm[0] == (-60.0, 0.0, 0.0)
    typical = find_robot("par4-table1").robot.mechanism.plate
    assert typical.reflector_mm == (0.0, 0.0, 0.0)
    assert np.linalg.norm(typical.joints_mm, axis=1) == pytest.approx(50.0)


def rods_of(member, rods_mm, tilts_rad, leans_rad):
    """Simulator's rods of a member, and the model's robot of the same parts."""
    space, plate, kind = member.space, member.mechanism.plate, PLATE_KINDS[member.name]
    flat = member.nominal.parameters
    geometry = geometry_of({name: flat[name] for name in kind.names}, kind)
    leans = leans_rad if kind.on_rails else None
    build = Build(np.array(plate.joints_mm), SPACING_MM, rods_mm, tilts_rad, leans)
    p = member.nominal.p.copy()

    places = space.columns
    p[places["forearm"]] += rods_mm.mean(axis=1)
    p[places["parallelogram_skew"]] = (rods_mm[:, 1] - rods_mm[:, 0]) / SPACING_MM
    p[places["axis_tilt"]] = tilts_rad
    if kind.on_rails:
        leaning = turned(geometry.rails, geometry.sideways, leans_rad)
        rails = turned(leaning, geometry.outward, tilts_rad)
        p[places["rail_tilt"]] = np.arcsin(rails[:, 1])
        p[places["elevation"]] = np.arctan2(rails[:, 2], rails[:, 0])
    return RodMechanism(geometry, build), Kinematics(member.mechanism, p)


@pytest.mark.parametrize(
    ("rod_mm", "tilt_rad", "left_um"),
    [(0.05, 5e-4, 0.4), (0.16, 2e-3, 1.0)],
    ids=["good", "2 mrad"],
)
@all_members
def test_rods_and_axes_move_the_reflector_as_the_simulators_do(member, rod_mm, tilt_rad, left_um):
    rng, arms = np.random.default_rng(11), member.space.arms
    rods_mm = rng.normal(0.0, rod_mm, (arms, 2))
    tilts_rad, leans_rad = rng.normal(0.0, tilt_rad, (2, arms))
    rods, robot = rods_of(member, rods_mm, tilts_rad, leans_rad)
    near = member.reachable_poses(member.nominal, 30, seed=12, limits=member.well_inside)
    joints = member.nominal.inverse(near).values_or_raise()
    poses = robot.forward(joints).values_or_raise()
    reflector_mm = np.array(member.mechanism.plate.reflector_mm)
    points, turns = [], []
    for q, pose in zip(joints, poses, strict=True):
        guess = Plate.level(rods.kind, pose[:3], float(pose[3:].sum()))
        plate = rods.settle(q, guess)[0]
        points.append(rods.reflector_mm(plate, reflector_mm) - reflector_mm)
        turns.append(Rotation.from_matrix(plate.rotation).as_rotvec())
    assert 1e3 * rms(poses[:, :3] - points) < left_um
    assert rms(near[:, :3] - points) > 40.0 * 1e-3 * left_um
    assert rms(tilts_of(robot, joints) - np.array(turns)) < 0.01 * rms(np.array(turns))
