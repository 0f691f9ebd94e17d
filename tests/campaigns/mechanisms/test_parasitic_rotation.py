"""Plate tilt by unequal rods and tilted axes, against the simulator's rods, which share nothing."""

from dataclasses import replace

import numpy as np
import pytest
from family_cases import ALL_MEMBERS
from par4_cases import NOMINAL, TILTED, reachable_joints
from par4_space import SKEWS, TILTS, places_of
from scipy.spatial.transform import Rotation

from campaigns.estimation.observability import observability
from campaigns.estimation.residuals import PointResiduals, PositionModel
from campaigns.mechanisms import parasitic_rotation
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.par4 import PAR4
from campaigns.robots.robot import find_robot
from sim.geometry import KINDS, geometry_of
from sim.robot.rods import Build, Plate, RodMechanism, turned

DRAWING = parasitic_rotation.PlateGeometry(
    ((-60.0, 5.0, 3.0), (55.0, 0.0, -2.0), (60.0, 10.0, 0.0), (-70.0, 0.0, 4.0)),
    (20.0, -30.0, -45.0),
)
SPACING_MM = 80.0
DRAWN = PAR4.with_plate(DRAWING)


def made(rods_mm, tilts_rad):
    """Robot of the model whose forearms are pairs of rods, each so much too long."""
    p = NOMINAL.p.copy()
    p[places_of("forearm_mm")] += rods_mm.mean(axis=1)
    p[SKEWS] = (rods_mm[:, 1] - rods_mm[:, 0]) / SPACING_MM
    p[TILTS] = tilts_rad
    return Kinematics(DRAWN, p)


def rms(vectors):
    return np.sqrt((vectors**2).sum(axis=1).mean())


def test_perfect_parts_leave_the_plate_level_and_one_bad_row_the_others_alone():
    joints = reachable_joints(NOMINAL, 20, seed=4)
    poses = NOMINAL.forward(joints).values_or_raise()
    assert (DRAWN.plate_tilt(NOMINAL.p, joints, poses) == 0.0).all()
    assert (DRAWN.forward(NOMINAL.p, joints).values == poses).all()
    joints = reachable_joints(TILTED, 5, seed=6)
    p = TILTED.p.copy()
    bad = joints.copy()
    bad[2] = [-3.0, 3.0, 1.0, -2.0]
    found = DRAWN.forward(p, bad)
    assert found.found.tolist() == [True, True, False, True, True]
    good = DRAWN.forward(p, joints).values
    assert np.abs(found.values - good)[found.found].max() < 1e-9


def test_the_reflector_s_place_matters_as_much_as_the_plate_turns():
    """A drawing that is wrong by 18 mm costs a fraction of a micrometre of what is modelled."""
    rng = np.random.default_rng(7)
    robot = made(rng.normal(0.0, 0.05, (4, 2)), rng.normal(0.0, 3e-4, 4))
    joints = reachable_joints(NOMINAL, 60, seed=7)
    wrong = PAR4.with_plate(replace(DRAWING, reflector_mm=(30.0, -20.0, -35.0)))
    poses = robot.forward(joints).values_or_raise()[:, :3]
    apart = wrong.forward(robot.p, joints).values_or_raise()[:, :3] - poses
    apart -= apart.mean(axis=0)
    turn = DRAWN.plate_tilt(robot.p, joints, robot.forward(joints).values)
    turn -= turn.mean(axis=0)
    assert rms(apart) < 1.2 * 18.0 * rms(turn)


@pytest.mark.parametrize("size", 10.0 ** -np.arange(0, 12))
def test_gibbs_vectors_are_rotations_in_every_decade(size):
    axes = np.random.default_rng(8).normal(size=(3, 5))
    gibbs = size * axes / np.linalg.norm(axes, axis=0)
    turns = Rotation.from_rotvec(parasitic_rotation.rotation_vectors(gibbs).T)
    r_minus_i = parasitic_rotation.rotation_minus_identity(gibbs).transpose(2, 0, 1)
    assert np.abs(r_minus_i + np.eye(3) - turns.as_matrix()).max() < 1e-15
    vectors = np.random.default_rng(9).normal(size=(3, 2, 5))
    moved = parasitic_rotation.displacement(gibbs, vectors)
    expected = turns.apply(vectors[:, 1].T) - vectors[:, 1].T
    assert np.abs(moved[:, 1].T - expected).max() < 1e-14
    assert np.abs(moved).max() < 10.0 * size


@pytest.mark.parametrize(
    ("size", "inverse"),
    [(3, parasitic_rotation.inverse_of_three), (4, parasitic_rotation.inverse_of_four)],
)
def test_inverses_by_hand_are_exact_and_refuse_a_singular_system(size, inverse):
    systems = np.random.default_rng(5).standard_normal((size, size, 50))
    whole = np.einsum("abn,bcn->nac", systems, inverse(systems))
    assert whole == pytest.approx(np.broadcast_to(np.eye(size), whole.shape), abs=1e-9)
    systems[1, :, 7] = systems[0, :, 7] = [1.0, 2.0, 4.0, 8.0][:size]
    with pytest.raises(np.linalg.LinAlgError):
        inverse(systems)


def test_a_drawing_is_read_from_the_robot_s_file_and_typical_without_one():
    drawn = find_robot("par4-prototype").robot.mechanism.plate
    assert drawn.reflector_mm == (20.0, -30.0, -45.0)
    assert drawn.joints_mm[0] == (-60.0, 0.0, 0.0)
    typical = find_robot("par4-table1").robot.mechanism.plate
    assert typical.reflector_mm == (0.0, 0.0, 0.0)
    assert np.linalg.norm(typical.joints_mm, axis=1) == pytest.approx(50.0)


def rods_of(member, rods_mm, tilts_rad, leans_rad):
    """Simulator's rods of a member, and the model's robot of the same parts."""
    space, plate, kind = member.space, member.mechanism.plate, KINDS[member.name]
    flat = member.nominal.parameters
    geometry = geometry_of({name: flat[name] for name in kind.names}, kind)
    leans = leans_rad if kind.on_rails else None
    build = Build(np.array(plate.joints_mm), SPACING_MM, rods_mm, tilts_rad, leans)
    p = member.nominal.p.copy()

    def places(field):
        return space.places(space.of_field(field))

    p[places("forearm_mm")] += rods_mm.mean(axis=1)
    p[places("parallelogram_skew_deg")] = (rods_mm[:, 1] - rods_mm[:, 0]) / SPACING_MM
    p[places("axis_tilt_deg")] = tilts_rad
    if kind.on_rails:
        leaning = turned(geometry.rails, geometry.sideways, leans_rad)
        rails = turned(leaning, geometry.outward, tilts_rad)
        p[places("rail_tilt_deg")] = np.arcsin(rails[:, 1])
        p[places("elevation_deg")] = np.arctan2(rails[:, 2], rails[:, 0])
    return RodMechanism(geometry, build), Kinematics(member.mechanism, p)


@pytest.mark.parametrize("member", ALL_MEMBERS, ids=lambda each: each.name)
def test_every_member_s_rods_and_axes_move_the_reflector_as_its_rods_do(member):
    rod_mm, tilt_rad, left_um = 0.05, 5e-4, 0.4
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
    tilt = member.mechanism.plate_tilt(robot.p, joints, poses)
    assert rms(tilt - np.array(turns)) < 0.01 * rms(np.array(turns))


@pytest.mark.parametrize("member", ALL_MEMBERS, ids=lambda each: each.name)
def test_what_shots_tell_of_the_full_model_but_not_of_the_frame(member):
    """With all tilts free the robot could be turned whole; two of them hold it."""
    poses = member.reachable_poses(member.nominal, 150, seed=13)
    joints = member.nominal.inverse(poses).values_or_raise()
    free = member.space.free_in_full
    problem = PointResiduals.from_points(
        PositionModel(member.nominal, member.space.places(free), joints),
        poses[:, :3],
        np.tile(1e-4 * np.eye(3), (len(poses), 1, 1)),
    )
    assert observability(problem.jacobian(problem.start())).rank == len(free) + 6
    assert len(free) - len(member.space.free_by_default) == 2 * member.space.arms - 2 + len(
        [name for name in free if name.endswith(("rail_tilt_deg", "elevation_deg"))]
    )
