"""The model beyond 22 parameters: azimuths, axis tilts, skews, and gears with lost motion."""

import numpy as np
import pytest
from par4_cases import (
    LIMITS,
    NOMINAL,
    TABLE1,
    TILTED,
    TRACKER_STD_MM,
    WELL_INSIDE,
    central_differences,
    measured_points,
    reachable_joints,
)
from par4_space import BACKLASHES, SKEWS, SPACE, TILTS, par4_of, places_of

from campaigns.estimation.least_squares import solve
from campaigns.estimation.observability import observability
from campaigns.estimation.point_sets import distances_mm
from campaigns.estimation.residuals import DistanceResiduals, PointResiduals, PositionModel
from sim.geometry import geometry_of
from sim.random_streams import Attempts, WorkedTime, target_key
from sim.robot.assembly import assemble
from sim.robot.driven_robot import Behaviour, DrivenRobot, SeenReflector, Standing
from sim.robot.rods import Build, RodMechanism
from sim.robot.section import Thermal
from sim.robot.transmission import Transmission

ARCSEC = np.radians(1.0 / 3600.0)
ALL = SPACE.places(SPACE.of_robot)
FREE = SPACE.places(SPACE.free_if_extended)
OF_FULL = SPACE.places(SPACE.free_in_full)
OF_GEOMETRY = slice(0, len(SPACE.geometry))
BACKLASH_RAD = np.array([60.0, 20.0, -10.0, 90.0]) * ARCSEC
"""One has the wrong sign, which a fit must be able to say."""
AZIMUTH_ERRORS_RAD = np.array([0.0, 5e-4, -3e-4, 8e-4])
AXIS_TILTS_RAD = np.array([0.0, 0.0, 2e-4, -7e-4])
"""The axes of arms 0 and 1 are the frame's horizontal."""
SKEWS_RAD = np.array([6e-4, -3e-4, -5e-4, 9e-4])


def as_made():
    made = TABLE1.p.copy()
    made[places_of("azimuth_deg")] += AZIMUTH_ERRORS_RAD
    made[TILTS], made[SKEWS] = AXIS_TILTS_RAD, SKEWS_RAD
    return par4_of(made)


MADE = as_made()
"""A robot as a workshop makes it, seen in the frame of its first arm."""


def leaning(robot=TABLE1):
    """Tilts and skews of some mrad, a few times what workshops leave, on Table I's robot."""
    p = robot.p.copy()
    p[[*TILTS, *SKEWS]] = 0.1 * TILTED.p[[*TILTS, *SKEWS]]
    return par4_of(p)


LEANING = leaning()


def approaches(count, seed=7):
    return np.random.default_rng(seed).choice([-1.0, 0.0, 1.0], (count, 4), p=[0.45, 0.1, 0.45])


def model(nominal, joints, approach, free=FREE):
    return PositionModel(nominal, free, joints, approach=approach)


def with_backlash(model, backlash_rad):
    """The model's nominal parameters with these backlashes; all are free."""
    x = model.nominal.copy()
    x[BACKLASHES] = backlash_rad
    return x


def backlash_in(free, x):
    """Of the four gears, among the values of the free parameters."""
    return x[[free.index(name) for name in SPACE.backlashes]]


def points_problem(model, points_mm):
    covariance_mm2 = np.tile(TRACKER_STD_MM**2 * np.eye(3), (len(points_mm), 1, 1))
    return PointResiduals.from_points(model, points_mm, covariance_mm2)


def test_an_arm_stays_behind_its_encoder_by_half_of_the_backlash():
    joints = reachable_joints(LEANING, 30, seed=61, limits=WELL_INSIDE)
    approach = approaches(30)
    behind = joints - 0.5 * approach * BACKLASH_RAD
    tried = model(LEANING, joints, approach, ALL)
    x = with_backlash(tried, BACKLASH_RAD)
    expected = LEANING.forward(behind).values_or_raise()[:, :3]
    assert np.abs(tried.positions_mm(x) - expected).max() < 1e-9
    assert np.abs(tried.arm_joints(x) - behind).max() < 1e-15
    assert (tried.kinematics(x).p[OF_GEOMETRY] == LEANING.p[OF_GEOMETRY]).all()
    stood = tried.kinematics(x).forward(joints, approach=approach).values_or_raise()
    assert np.abs(stood[:, :3] - expected).max() < 1e-9


@pytest.mark.parametrize("approach", [None, np.zeros((12, 4))])
def test_where_no_direction_is_known_backlash_has_no_effect(approach):
    joints = reachable_joints(NOMINAL, 12, seed=62, limits=WELL_INSIDE)
    unknown = model(NOMINAL, joints, approach, ALL)
    x = with_backlash(unknown, BACKLASH_RAD)
    assert (unknown.positions_mm(x) == model(NOMINAL, joints, None).positions_mm(x[FREE])).all()
    assert (unknown.jacobian(x)[:, :, BACKLASHES] == 0.0).all()


def test_a_model_without_backlash_has_none():
    joints = reachable_joints(NOMINAL, 5, seed=63)
    standard = model(NOMINAL, joints, approaches(5), SPACE.places(SPACE.free_by_default))
    assert (standard.arm_joints(standard.nominal) == joints).all()


@pytest.mark.parametrize("size", 10.0 ** np.arange(-7, 2))
def test_poses_followed_from_other_parameters_are_those_of_the_new_ones(size):
    joints = reachable_joints(LEANING, 30, seed=66, limits=WELL_INSIDE)
    followed = model(LEANING, joints, None)
    about, rng = followed.nominal, np.random.default_rng(67)
    unit = np.array([1.0 if name.endswith("_mm") else 0.01 for name in SPACE.free_if_extended])
    x = about + size * unit * rng.uniform(-1.0, 1.0, len(about))
    followed.jacobian(about)
    afresh = followed.kinematics(x).forward(joints).values_or_raise()[:, :3]
    moved_mm = np.abs(afresh - followed.positions_mm(about)).max()
    assert np.abs(followed.positions_mm(x) - afresh).max() < 1e-10 + 1e-6 * moved_mm
    known = model(followed.kinematics(x), joints, None)
    expected = known.jacobian(known.nominal)
    off = np.abs(followed.jacobian(x) - expected).max(axis=(0, 1))
    assert (off <= 1e-6 * np.abs(expected).max(axis=(0, 1))).all()


def test_derivative_of_the_position_by_each_backlash_is_that_of_its_joint_both_ways():
    joints = reachable_joints(LEANING, 4, seed=64, limits=WELL_INSIDE)
    tried = model(LEANING, joints, approaches(4), ALL)
    exact = tried.jacobian(with_backlash(tried, BACKLASH_RAD))[:, :, BACKLASHES]

    def moved(backlash_rad):
        return tried.positions_mm(with_backlash(tried, backlash_rad))

    found = central_differences(moved, BACKLASH_RAD, np.full(4, 1e-4))
    assert np.abs(found - exact).max() < 1e-7 * np.abs(exact).max()


def test_35_parameters_can_be_told_apart_when_the_directions_of_approach_are_known():
    joints = reachable_joints(NOMINAL, 120, seed=65, limits=LIMITS)
    points_mm = measured_points(NOMINAL, joints)

    def rank(approach, names=SPACE.free_if_extended):
        problem = points_problem(model(NOMINAL, joints, approach, SPACE.places(names)), points_mm)
        return observability(problem.jacobian(problem.start())).rank - 6

    assert len(SPACE.free_if_extended) == 35
    assert rank(approaches(120)) == 35
    assert rank(None) == 31
    turns = ("arm0.azimuth_deg", "arm0.axis_tilt_deg", "arm1.axis_tilt_deg")
    assert rank(approaches(120), (*turns, *SPACE.free_if_extended)) == 35


def problems_of(points_mm, tried):
    first, second = np.arange(0, len(points_mm), 2), np.arange(1, len(points_mm), 2)
    measured_mm = distances_mm(points_mm, first, second)
    return {
        "points": points_problem(tried, points_mm),
        "distances": DistanceResiduals.in_mm(tried, first, second, measured_mm),
    }


@pytest.mark.parametrize("robot", [TABLE1, LEANING], ids=["level", "tilted"])
def test_derivatives_by_parameters_that_are_not_free_are_those_of_a_fit_that_frees_all(robot):
    joints, every = reachable_joints(robot, 10, seed=70), np.arange(len(SPACE.geometry))
    found, exact = (
        tried.by_geometry(tried.nominal, every)
        for tried in (model(robot, joints, None, free) for free in (OF_FULL, ALL))
    )
    assert np.abs(found - exact).max() <= 1e-12 * np.abs(exact).max()


@pytest.mark.parametrize("estimator", ["points", "distances"])
def test_azimuths_tilts_and_backlash_are_found_from_exact_shots(estimator):
    joints, approach = reachable_joints(MADE, 120, seed=66), approaches(120)
    points_mm = measured_points(MADE, joints - 0.5 * approach * BACKLASH_RAD)
    tried = model(NOMINAL, joints, approach)
    fit = solve(problems_of(points_mm, tried)[estimator])
    found = fit.x[: len(FREE)]
    assert fit.converged
    assert np.abs((tried.kinematics(found).p - MADE.p)[OF_GEOMETRY]).max() < 1e-6
    assert np.abs(backlash_in(SPACE.free_if_extended, found) - BACKLASH_RAD).max() < 1e-8


@pytest.mark.parametrize("made", [MADE, leaning(NOMINAL)], ids=["all wrong", "tilts alone"])
@pytest.mark.parametrize("estimator", ["points", "distances"])
def test_first_steps_of_a_level_plate_lead_to_the_minimum_of_the_tilted_one(made, estimator):
    """By no more evaluations of a tilted plate: those of a level one take half the time."""
    joints, free = reachable_joints(made, 120, seed=68, limits=WELL_INSIDE), SPACE.free_in_full
    points_mm = made.forward(joints).values_or_raise()[:, :3]
    points_mm += TRACKER_STD_MM * np.random.default_rng(69).standard_normal(points_mm.shape)
    tried = model(NOMINAL, joints, None, SPACE.places(free))
    problem, tilted = problems_of(points_mm, tried)[estimator], list[bytes]()
    positions_mm = recorded(tried.positions_mm, tilted, lambda x: x[tried.fine_parameters].any())
    tried.positions_mm = positions_mm
    tilting = [place for place, name in enumerate(free) if name in SPACE.extensions]
    assert np.flatnonzero(problem.fine_unknowns()).tolist() == tilting
    found, by_steps = solve(problem), len(set(tilted))
    tilted.clear()
    all_at_once = solve(problem, start=problem.start())
    assert found.converged
    assert by_steps <= len(set(tilted))
    assert np.abs(found.x - all_at_once.x).max() < 1e-8


def test_a_level_plate_is_left_after_two_steps_by_one_jacobian():
    """Seen by the models asked of: a tilted plate costs twice as much as a level one."""
    joints, free = reachable_joints(TABLE1, 60, seed=68, limits=WELL_INSIDE), SPACE.free_in_full
    points_mm = TABLE1.forward(joints).values_or_raise()[:, :3]
    tried = model(NOMINAL, joints, None, SPACE.places(free))
    asked = {"positions_mm": [], "jacobian": []}
    for name, seen in asked.items():
        level = recorded(getattr(tried, name), seen, lambda x: not x[tried.fine_parameters].any())
        setattr(tried, name, level)
    assert solve(problems_of(points_mm, tried)["distances"]).converged
    assert [len(set(each)) for each in asked.values()] == [3, 2]


def recorded(work, seen, counts):
    """The work, which notes its arguments that count."""

    def done(x):
        if counts(x):
            seen.append(x.tobytes())
        return work(x)

    return done


def driven_robot(backlash_rad):
    """The simulator's eight rods on gears with lost motion, and nothing else wrong."""
    made = geometry_of(NOMINAL.parameters)
    rods = RodMechanism(made, Build(np.zeros((4, 3)), 80.0, np.zeros((4, 2)), np.zeros(4)))
    start = assemble(rods, made, np.array([0.0, 0.0, -575.0]), 0.0)
    return DrivenRobot(
        rods,
        Behaviour(backlash_rad, 0.0, 0.0, Thermal(), Transmission.perfect(4)),
        SeenReflector(np.array([20.0, -30.0, -45.0]), np.array([1.0, 0.0, 0.0])),
        Standing(start.joints, np.zeros(4), start, np.zeros(3)),
        seed=1,
        worked=WorkedTime(0.0),
        arrivals=Attempts({}),
    )


def visited(robot, targets):
    """Joints, points and directions of approach at the targets that the straight way leads to."""
    joints, points, approach = [], [], []
    for encoders in targets:
        if robot.passable_part(encoders) < 1.0:
            continue
        approach.append(np.sign(encoders - robot.standing.encoders))
        robot.arrive(encoders, target_key(encoders))
        joints.append(encoders)
        points.append(robot.reflector(encoders).point_mm)
    return np.array(joints), np.array(points), np.array(approach)


@pytest.mark.slow
def test_the_simulated_gears_lost_motion_is_found_with_its_sign():
    free = SPACE.free_if_extended
    true_rad = np.array([60.0, 20.0, 40.0, 90.0]) * ARCSEC
    targets = reachable_joints(NOMINAL, 70, seed=67, limits=WELL_INSIDE)
    joints, points_mm, approach = visited(driven_robot(true_rad), targets)
    assert len(joints) > 50
    tried = model(NOMINAL, joints, approach, SPACE.places(free))
    fit = solve(points_problem(tried, points_mm))
    found = fit.x[: len(free)]
    assert fit.converged
    assert np.abs(backlash_in(free, found) - true_rad).max() < 0.01 * ARCSEC
    assert np.abs((tried.kinematics(found).p - NOMINAL.p)[OF_GEOMETRY]).max() < 1e-6
