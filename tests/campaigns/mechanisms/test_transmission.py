"""Transmission of joints: against independent shots, by differences, for every member."""

import json

import numpy as np
import pytest
from family_cases import VECTORS, all_members, flat_in
from par4_cases import NOMINAL, central_differences

from app.new_campaign import cell_text
from campaigns.estimation.least_squares import solve
from campaigns.estimation.residuals import PointResiduals, PositionModel
from campaigns.mechanisms.parameters import Parameters
from campaigns.mechanisms.transmission import approach_along
from campaigns.shots.shots import shots_of_rows
from campaigns.shots.shots_csv import read_shots
from sim.geometry import geometry_of
from sim.robot.rods import Build, Growth, Plate, RodMechanism
from sim.scenarios.scenario import parse_scenario

SIZES = {"deg": np.radians(0.03), "mm": 0.04, "ppm": 300e-6}
FIELDS = {
    "a_deg": "eccentricity_sin_deg",
    "b_deg": "eccentricity_cos_deg",
    "c_deg": "ripple_sin_deg",
    "d_deg": "ripple_cos_deg",
    "beta_deg": "backlash_deg",
}


def geared(member):
    """Perturbed robot whose joints all have every error, and sides of approach of three shots."""
    robot = member.perturbed
    rate = 30.0 if member.mechanism.joints[0].is_revolute else 20.0
    p, space, draw = robot.p.copy(), member.space, np.random.default_rng(3)
    for name in space.transmission:
        p[space.places([name])] = SIZES[space[name].unit] * draw.uniform(-1.0, 1.0)
    poses = member.reachable_poses(robot, 3, seed=5, limits=member.well_inside)
    own = type(robot)(robot.mechanism.with_ripples(rate), p)
    return own, poses, draw.choice([-1.0, 0.0, 1.0], (3, space.arms))


@all_members
def test_readings_and_poses_undo_each_other_from_either_side(member):
    robot, poses, approach = geared(member)
    joints = robot.inverse(poses, approach).values_or_raise()
    found = robot.forward(joints, approach=approach).values_or_raise()
    assert np.abs(found - poses).max() < 1e-9
    assert np.abs(robot.forward(joints).values_or_raise() - poses).max() > 1e-3
    assert np.abs(member.perturbed.inverse(poses).values_or_raise() - joints).max() > 1e-5


@all_members
def test_derivatives_by_every_parameter_are_those_of_differences(member):
    robot, poses, approach = geared(member)
    joints, space = robot.inverse(poses, approach).values_or_raise(), member.space
    scale = robot.mechanism.sensitivity_scale_mm(robot.p)[: len(robot.p)]

    def moved(vector):
        return type(robot)(robot.mechanism, vector).forward(joints, poses, approach).values

    exact = robot.jacobian(joints, poses, approach) / scale
    differences = central_differences(moved, robot.p, 0.01 / scale) / scale
    assert np.abs(exact - differences).max() < 1e-6 * np.abs(exact).max()
    assert (np.abs(exact[:, :, space.places(space.transmission)]).max(axis=(0, 1)) > 1e-3).all()


@all_members
def test_a_warm_robot_grows_as_its_lengths_do(member):
    robot, poses, approach = geared(member)
    joints, space = robot.inverse(poses, approach).values_or_raise(), member.space
    regressor = np.array([0.0, 1.0, -2.0])
    places = space.places(space.thermal)
    model = PositionModel(robot, places, joints, poses, approach=approach, regressor=regressor)
    x = np.array([20e-6, 11e-6, 7e-6])
    groups = (("arm_mm",), ("forearm_mm",), ("x_mm", "y_mm", "z_mm"))
    for row, warmth in enumerate(regressor):
        p, side = robot.p.copy(), approach[[row]]
        for growth, fields in zip(x, groups, strict=True):
            p[space.places(space.of_field(*fields))] *= 1.0 + growth * warmth
        for axis, joints_mm in zip(
            "xyz", np.transpose(robot.mechanism.plate.joints_mm), strict=True
        ):
            p[space.places(space.of_field(f"{axis}_mm"))] += x[2] * warmth * joints_mm
        if not robot.mechanism.joints[0].is_revolute:
            travelled = robot.mechanism.true_joints(p, joints[[row]], side)[0]
            p[space.offsets] += x[0] * warmth * (travelled + p[space.offsets])
        warm = type(robot)(robot.mechanism, p).forward(joints[[row]], poses[[row]], side)
        assert np.abs(model.poses(x)[row] - warm.values[0]).max() < 1e-6
        ppm = dict(zip(space.thermal, (1e6 * warmth * x).tolist(), strict=True))
        grown = robot.mechanism.grown(Parameters.of_vector(space, robot.p), ppm)
        warm = type(robot)(robot.mechanism, grown.vector).forward(joints[[row]], poses[[row]], side)
        assert np.abs(model.poses(x)[row] - warm.values[0]).max() < 1e-6
    cold = model.kinematics(x).forward(joints, poses, approach).values
    assert np.abs(cold - poses).max() < 1e-9
    differences = central_differences(model.positions_mm, x, np.full(3, 1e-5))
    assert np.abs(model.jacobian(x) - differences).max() < 1e-6 * np.abs(differences).max()


@all_members
def test_a_frame_that_grows_beside_a_cold_plate_moves_points_as_independent_rods_do(member):
    robot, ppm = member.nominal.controlled, 1100.0
    section = parse_scenario(cell_text(member.shipped, "drawn-robots"), member.name).robot
    joints_mm, level = np.array(robot.mechanism.plate.joints_mm), np.zeros(member.space.arms)
    build = Build(joints_mm, section.rod_spacing_mm, np.zeros((len(level), 2)), level)
    flat = {name: robot.parameters[name] for name in section.kind.names}
    rods = RodMechanism(geometry_of(flat, section.kind), build)
    poses = member.reachable_poses(robot, 5, seed=6, limits=member.well_inside)
    joints = robot.inverse(poses).values_or_raise()
    starts = [Plate.level(section.kind, row[:3], float(row[3:].sum())) for row in poses]
    growth = Growth(frame=1e-6 * ppm)
    true = [rods.settle(*each, growth)[0].position_mm for each in zip(joints, starts, strict=True)]
    grown = robot.mechanism.grown(robot.parameters, {"frame_expansion_ppm": ppm})
    warm = type(robot)(robot.mechanism, grown.vector).forward(joints, poses).values_or_raise()
    assert np.abs(np.array(true) - poses[:, :3]).max() > 0.1
    assert np.abs(np.array(true) - warm[:, :3]).max() < 1e-9


def shots(case):
    """Shots of a vector's file, whose columns `side0` … say how joints came, and its answers."""
    path = VECTORS / f"{case}.csv"
    data = shots_of_rows(read_shots(path, NOMINAL.mechanism), NOMINAL)
    return data, json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))


def named(answer):
    """Values of an answer by the names of parameters."""
    flat = flat_in(answer["geometry"])
    return flat | {
        f"arm{arm}.{field}": value
        for key, field in FIELDS.items()
        for arm, value in enumerate(answer[key])
    }


@pytest.mark.parametrize(
    ("case", "answer", "within"),
    [
        ("transmission-exact", "truth", {"mm": 1e-6, "deg": 1e-7}),
        ("transmission-noise", "least_squares_points", {"mm": 1e-5, "deg": 1e-7}),
    ],
)
def test_all_terms_are_found_as_an_independent_model_has_them(case, answer, within):
    data, answers = shots(case)
    nominal = type(NOMINAL)(NOMINAL.mechanism.with_ripples(answers["N"]), NOMINAL.p)
    space, expected = nominal.mechanism.parameters, named(answers[answer])
    added = tuple(name for name in space.transmission if name in expected)
    free = (*space.free_by_default, *added)
    assert len(free) == 42
    model = PositionModel(nominal, space.places(free), data.joints, approach=data.approach)
    measured = data.points_in_tracker_mm, data.stated_covariance_mm2
    fit = solve(PointResiduals.from_points(model, *measured))
    found = fit.x[: len(free)] / space.units(free)
    assert fit.converged
    for name, value in zip(free, found, strict=True):
        assert abs(value - expected[name]) < within[space[name].unit], name


def test_joints_keep_the_side_that_they_came_from_while_they_stand():
    joints = np.array([[0.0, 1.0], [0.1, 1.0], [0.1, 0.9], [0.0, 0.9]])
    assert approach_along(joints).tolist() == [[0, 0], [1, 0], [1, -1], [-1, -1]]
