"""The eight-rod mechanism: tied to the contracted equations, and departing where it should."""

import math

import numpy as np
import pytest

from sim.errors import AssemblyLost
from sim.geometry import UP, geometry_of
from sim.robot.assembly import OutOfReach, assemble, follow, joints_for, plate_joints_mm, restore
from sim.robot.rods import Build, Growth, Plate, RodMechanism
from sim.robot.section import nominal_robot
from sim.scenarios.scenario import load_scenario

PLATE_JOINTS_MM = np.array([[-60, 5, 3], [55, 0, -2], [60, 10, 0], [-70, 0, 4.0]])
CENTRE_MM = np.array([0.0, 0.0, -575.0])


def mechanism(geometry, *, rod_mm=0.0, tilt_mrad=0.0, seed=0):
    draw = np.random.default_rng(seed)
    build = Build(
        plate_joints_mm=PLATE_JOINTS_MM,
        rod_spacing_mm=80.0,
        rod_errors_mm=rod_mm * draw.standard_normal((4, 2)),
        axis_tilts_rad=1e-3 * tilt_mrad * draw.standard_normal(4),
    )
    return RodMechanism(geometry, build)


def reachable_joints(geometry, count, seed):
    draw = np.random.default_rng(seed)
    reachable = []
    while len(reachable) < count:
        place_mm = draw.uniform([-520, -550, -990], [520, 450, -270])
        try:
            joints = joints_for(geometry, place_mm, draw.uniform(-math.pi / 4, math.pi / 4))
        except OutOfReach:
            continue
        if np.degrees(joints).min() >= -45 and np.degrees(joints).max() <= 90:
            reachable.append(joints)
    return reachable


def contracted_misfit_mm(geometry, joints, plate):
    """|A_i B'_i| − L_i, written down directly from the paper's equations."""
    angles = joints + geometry.joint_offsets
    elbows_mm = geometry.motors_mm + geometry.arms_mm[:, None] * (
        np.cos(angles)[:, None] * geometry.outward - np.sin(angles)[:, None] * UP
    )
    joints_mm = plate_joints_mm(geometry, plate.position_mm, plate.theta_rad)
    return np.linalg.norm(joints_mm - elbows_mm, axis=1) - geometry.forearms_mm


@pytest.fixture
def geometry():
    return geometry_of(nominal_robot("par4-prototype")[1])


@pytest.mark.parametrize("name", ["paper-simulation", "paper-prototype"])
def test_perfect_rods_equal_the_contracted_model(name):
    geometry = geometry_of(load_scenario(name).robot.true_flat())
    rods = mechanism(geometry)
    centre = assemble(rods, geometry, CENTRE_MM, 0.0)
    for joints in reachable_joints(geometry, 40, seed=7):
        here = follow(rods, centre, joints)
        assert abs(contracted_misfit_mm(geometry, joints, here.plate)).max() < 1e-9
        assert abs(here.plate.unknowns[3:6]).max() < 1e-11
        back = joints_for(geometry, here.plate.position_mm, here.plate.theta_rad)
        assert abs(back - joints).max() < 1e-11


def test_unequal_rods_and_tilted_axes_shift_and_tilt_the_plate(geometry):
    perfect = mechanism(geometry)
    offset_mm = np.array([20.0, -30.0, -45.0])
    shifts_mm, tilts_mrad = [], []
    for seed in range(10):
        imperfect = mechanism(geometry, rod_mm=0.05, tilt_mrad=0.5, seed=seed)
        centre = assemble(perfect, geometry, CENTRE_MM, 0.0)
        for joints in reachable_joints(geometry, 3, seed=seed):
            ideal = follow(perfect, centre, joints).plate
            real, _, _ = imperfect.settle(joints, ideal)
            moved_mm = (
                real.position_mm - ideal.position_mm + (real.rotation - np.eye(3)) @ offset_mm
            )
            shifts_mm.append(np.linalg.norm(moved_mm))
            tilts_mrad.append(1e3 * np.linalg.norm(real.unknowns[3:6]))
    assert 0.2 < np.quantile(shifts_mm, 0.9) < 0.8
    assert 1.5 < np.quantile(tilts_mrad, 0.9) < 5.0


def test_a_tilted_motor_swings_its_arm_square_to_its_axis(geometry):
    rods = mechanism(geometry, tilt_mrad=200.0)
    motors_mm = geometry.motors_mm + PLATE_JOINTS_MM
    for joints_deg in (-30.0, 0.0, 50.0):
        ends_mm = rods.elbows_mm(np.radians([joints_deg] * 4)).reshape(4, 2, 3)
        bars_mm = ends_mm[:, 1] - ends_mm[:, 0]
        arms_mm = ends_mm.mean(axis=1) - motors_mm
        assert np.linalg.norm(bars_mm, axis=1) == pytest.approx(np.full(4, 80.0))
        assert np.linalg.norm(arms_mm, axis=1) == pytest.approx(geometry.arms_mm)
        assert np.einsum("ij,ij->i", arms_mm, bars_mm) == pytest.approx(np.zeros(4), abs=1e-9)
    assert abs(bars_mm[:, 2]).max() > 10.0


FRAME_MM = 30e-6 * np.linalg.norm(PLATE_JOINTS_MM, axis=1).max()
"""Growth of the motors' ways beyond the contracted ones: the plate's joints do not grow."""


@pytest.mark.parametrize(
    ("growth", "factors", "rest_mm"),
    [
        (Growth(arms=50e-6), {"arm_mm": 50e-6}, 1e-9),
        (Growth(forearms=40e-6), {"forearm_mm": 40e-6}, 1e-9),
        (Growth(frame=30e-6), dict.fromkeys(("x_mm", "y_mm", "z_mm"), 30e-6), FRAME_MM),
    ],
)
def test_a_robot_that_grows_is_a_larger_robot(geometry, growth, factors, rest_mm):
    rods = mechanism(geometry)
    cold = assemble(rods, geometry, CENTRE_MM, 0.0)
    warm = restore(rods, cold.joints, cold.plate, growth)
    nominal = nominal_robot("par4-prototype")[1]
    grown = {k: v * (1.0 + factors.get(k.rpartition(".")[2], 0.0)) for k, v in nominal.items()}
    assert abs(contracted_misfit_mm(geometry_of(grown), cold.joints, warm.plate)).max() < rest_mm
    assert abs(contracted_misfit_mm(geometry, cold.joints, warm.plate)).max() > 0.004


def test_joints_that_would_tear_the_robot_are_refused_and_the_way_is_open_up_to_there(geometry):
    rods = mechanism(geometry)
    centre = assemble(rods, geometry, CENTRE_MM, 0.0)
    target = np.radians([90.0, -45.0, 90.0, -45.0])
    with pytest.raises(AssemblyLost, match="no assembly") as lost:
        follow(rods, centre, target)
    assert 0.0 < lost.value.part < 1.0
    edge = centre.joints + 0.999 * lost.value.part * (target - centre.joints)
    assert abs(follow(rods, centre, edge).plate.theta_rad) < math.pi / 2


def test_the_other_assembly_of_the_same_joints_is_never_taken(geometry):
    rods = mechanism(geometry)
    centre = assemble(rods, geometry, CENTRE_MM, 0.0)
    turned = Plate(centre.plate.unknowns + np.array([0, -100.0, 60.0, 0, 0, 0, math.pi]))
    with pytest.raises(AssemblyLost):
        restore(rods, centre.joints, turned)


def test_the_rods_derivative_agrees_with_differences(geometry):
    step = 1e-5
    rods = mechanism(geometry, rod_mm=0.05, tilt_mrad=0.5)
    elbows_mm = rods.elbows_mm(np.radians([30.0, 40.0, 20.0, 25.0]))
    unknowns = np.array([10.0, -20.0, -560.0, 0.01, -0.02, 0.03, 0.3])
    _, jacobian = rods.misfit(elbows_mm, unknowns)
    for column in range(7):
        change = step * np.eye(7)[column]
        above, _ = rods.misfit(elbows_mm, unknowns + change)
        below, _ = rods.misfit(elbows_mm, unknowns - change)
        assert jacobian[:, column] == pytest.approx((above - below) / (2 * step), abs=1e-3)
